// Small traces of the last seconds of a trial, each on a canvas with its own scale.

import { fitted } from "./scene.js";

const SECONDS = 8;

const GUTTER = 30; // for the numbers of the scale [px]

const ofClutches = (name) => (tables) =>
  tables.clutches.map(({ colour }, k) => ({ colour, value: (trial, row) => trial.at(`${name}_${k + 1}`, row) }));

/** What is traced: lines by their colours, and how far the scale reaches at least. */
const KINDS = {
  error: {
    lines: () => [{ colour: "trail", value: (trial, k) => 1000 * trial.at("normal_error", k) }],
    least: 20,
    signed: true,
  },
  volts: {
    lines: ofClutches("volts"),
    least: 24,
    signed: false,
  },
  torques: {
    lines: ofClutches("torque"),
    least: 10,
    signed: true,
  },
  energy: {
    lines: () => [
      { colour: "force", width: 5, value: (trial, k) => trial.ledger[k].hand },
      { colour: "link-b", value: (trial, k) => trial.ledger[k].clutches },
      { colour: "link-a", value: (trial, k) => trial.ledger[k].kinetic },
    ],
    least: 1,
    signed: false,
  },
};

/** Draw the trace of a kind; with another trial beside it, that one is dashed. */
export function drawTrace(canvas, kind, trial, other, palette) {
  const { context, width: whole, height } = fitted(canvas);
  const width = whole - GUTTER;
  context.clearRect(0, 0, whole, height);
  context.translate(GUTTER, 0);
  if (kind === "mode") {
    drawModes(context, width, height, trial, palette);
    return;
  }
  const { lines, least, signed } = KINDS[kind];
  const curves = lines(trial.env.tables).flatMap(({ colour, value, width: thick = 1.75 }) => [
    { colour, thick, dash: [], points: sampled(trial, width, value) },
    ...(other && kind === "error" ? [{ colour: "link-b", thick, dash: [5, 4], points: sampled(other, width, value) }] : []),
  ]);
  const most = round(Math.max(least, ...curves.flatMap(({ points }) => points.map(([, value]) => Math.abs(value)))));
  const zero = signed ? height / 2 : height - 2;
  const scale = (zero - 3) / most;
  context.strokeStyle = palette.groove;
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(0, zero);
  context.lineTo(width, zero);
  context.stroke();
  context.lineJoin = "round";
  for (const { colour, thick, dash, points } of curves) {
    context.lineWidth = thick;
    context.strokeStyle = palette[colour];
    context.setLineDash(dash);
    context.beginPath();
    for (const [x, value] of points) context.lineTo(x, zero - scale * value);
    context.stroke();
  }
  context.setLineDash([]);
  const ends = signed ? [[`+${most}`, 1, "top"], ["0", zero, "middle"], [`−${most}`, height - 1, "bottom"]] : [[`${most}`, 1, "top"], ["0", height, "bottom"]];
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = palette.muted;
  context.textAlign = "right";
  for (const [text, y, baseline] of ends) {
    context.textBaseline = baseline;
    context.fillText(text, -5, y);
  }
}

/** Return the next number that ends a scale: 1, 2, 3, 5 or 8 times a power of ten; 24 for the volts. */
function round(value) {
  if (value === 24) return value;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 3, 5, 8, 10].find((each) => each * power >= value * (1 - 1e-9));
}

/** The dynamic modes as a band: empty where nothing is locked, a clutch's colour where it is, dark where all are. */
function drawModes(context, width, height, trial, palette) {
  const inks = { 0: palette.groove, 5: palette.ink };
  for (const { line, colour } of trial.env.tables.clutches) inks[line + 1] = palette[colour];
  const points = sampled(trial, width, (_, k) => trial.at("mode", k));
  points.forEach(([x, mode], k) => {
    const from = Math.round(x);
    const end = Math.round(points[k + 1]?.[0] ?? x + 1);
    context.fillStyle = inks[mode];
    const top = mode === 0 ? height - 4 : 2;
    context.fillRect(from, top, end - from, height - 2 - top);
  });
}

/** Return points [x, value] of the last seconds, about one for each pixel. */
function sampled(trial, width, value) {
  const shown = SECONDS / trial.period;
  const last = trial.rows.length - 1;
  const first = Math.max(0, last - shown);
  const step = Math.max(1, Math.floor(shown / width));
  const points = [];
  for (let k = first - (first % step) + (first % step ? step : 0); k < last; k += step) {
    points.push([((k - first) / shown) * width, value(trial, k)]);
  }
  points.push([((last - first) / shown) * width, value(trial, last)]);
  return points;
}
