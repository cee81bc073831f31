// Files of a person: pushes that are opened, and what is saved.

/** Return the forces { along, across } at control instants of a recording, a CSV file as `read_forces` reads it. */
export function readPush(text, period) {
  const [head, ...lines] = text.replace(/^\uFEFF/, "").split(/\r?\n/).filter((line) => line.trim() !== "");
  const names = (head ?? "").split(",").map((name) => name.trim());
  const places = ["time", "along", "across"].map((name) => names.indexOf(name));
  if (places.includes(-1)) throw new RangeError("A push is a CSV file with the columns time, along and across; this file has not.");
  const rows = lines.map((line) => {
    const cells = line.split(",");
    return places.map((place) => ((cells[place] ?? "").trim() === "" ? NaN : Number(cells[place])));
  });
  const bad = rows.findIndex((row, k) => !row.every(Number.isFinite) || (k === 0 ? row[0] !== 0 : row[0] <= rows[k - 1][0]));
  if (rows.length === 0) throw new RangeError("The file of the push has no rows.");
  if (bad >= 0) throw new RangeError(`Line ${bad + 2} of the push must have three numbers, and times must rise from 0.`);
  const count = Math.ceil(rows.at(-1)[0] / period - 1e-9) + 1;
  if (count > 6001) throw new RangeError("The push must not last longer than 60 s.");
  return { along: sampled(rows, 1, count, period), across: sampled(rows, 2, count, period) };
}

/** Return a column at the control instants, linear between rows. */
function sampled(rows, column, count, period) {
  let next = 0;
  return Array.from({ length: count }, (_, k) => {
    const time = k * period;
    while (next < rows.length && rows[next][0] < time) next++;
    if (next === rows.length) return rows.at(-1)[column];
    if (next === 0 || rows[next][0] === time) return rows[next][column];
    const [from, to] = [rows[next - 1], rows[next]];
    return from[column] + ((time - from[0]) / (to[0] - from[0])) * (to[column] - from[column]);
  });
}

/** Let a person save a text, or a Blob, as a file. */
export function save(name, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type: "text/csv" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
