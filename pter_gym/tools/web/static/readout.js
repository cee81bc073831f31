// The numbers of a trial beside its picture.

const byId = (id) => document.getElementById(id);

const MODES = ["free to move", ...[1, 2, 3, 4].map((n) => `clutch ${n} locked`), "all locked"];

/** Return in words what the clutches do: which is locked, or which slip where none is. */
function modeOf(trial) {
  const states = trial.env.tables.clutches.map((_, k) => trial.clutch(k));
  if (states.every((state) => state === "released")) return MODES[0];
  if (trial.now.mode > 0) return MODES[trial.now.mode];
  const slipping = states.flatMap((state, k) => (state === "slipping" ? [k + 1] : []));
  if (slipping.length === states.length) return "all slip";
  return slipping.length === 1 ? `clutch ${slipping[0]} slips` : `${slipping.join(", ")} slip`;
}

/** Return a number with its sign, a true minus, and no sign for a zero. */
function signed(value, digits) {
  const text = Math.abs(value).toFixed(digits);
  return Number(text) === 0 ? text : `${value < 0 ? "−" : "+"}${text}`;
}

function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Writes numbers into the page. */
export class Readout {
  constructor(clutches) {
    const body = byId("clutches").tBodies[0];
    this.clutches = clutches.map(({ name, colour }, k) => {
      const row = body.insertRow();
      const head = Object.assign(document.createElement("th"), { scope: "row" });
      const dot = document.createElement("i");
      dot.style.background = `var(--${colour})`;
      head.append(dot, String(k + 1));
      row.append(head);
      for (let cell = 0; cell < 4; cell++) row.insertCell();
      row.cells[1].textContent = name;
      return row;
    });
  }

  show(trial) {
    const { now } = trial;
    write(byId("time"), now.time.toFixed(2));
    write(byId("error"), signed(1000 * now.normal_error, 1));
    write(byId("speed"), trial.env.seen.speed_along.toFixed(2));
    write(byId("force"), Math.hypot(now.force_x, now.force_y).toFixed(0));
    write(byId("mode"), modeOf(trial));
    this.clutches.forEach((row, k) => {
      const state = trial.clutch(k);
      row.dataset.state = state;
      write(row.cells[2], `${now[`volts_${k + 1}`].toFixed(1)} V`);
      write(row.cells[3], `${signed(now[`torque_${k + 1}`], 1)} N·m`);
      write(row.cells[4], state === "stuck" ? "locked" : state);
    });
    const ledger = trial.ledger.at(-1);
    for (const name of ["hand", "kinetic", "clutches", "rounding"]) write(byId(`energy-${name}`), ledger[name].toFixed(2));
    write(byId("energy-given"), trial.given <= 1e-12 ? "0" : trial.given.toExponential(1));
  }
}
