// The text beside the arm: choices, present readings, and what every policy makes of a push.

const byId = (id) => document.getElementById(id);
const AT_PACE = 1.05; // ratio of paces up to which a run counts as on pace

export const millimetres = (metres) => `${(1000 * metres).toFixed(1)} mm`;

/** Fill a select element with names. */
export function fillSelect(select, names, chosen) {
  select.append(...names.map((name) => new Option(name, name, false, name === chosen)));
}

/** Return how a trial ended, in words. */
export function verdict({ ending, result, settings: { policy }, pace }) {
  if (ending === "left") return `${policy}: left the workspace.`;
  if (ending === "time") return `${policy}: time ran out before the end of the path.`;
  const error = millimetres(result.path_error_m);
  return `${policy}: path error ${error}, ${tempo(result.mean_pace_m_s, pace)}.`;
}

/** Return how a pace compares with the commanded one [m/s], such as “20 % too slow”. */
function tempo(pace, commanded) {
  const [ratio, way] = pace < commanded ? [commanded / pace, "slow"] : [pace / commanded, "fast"];
  if (ratio < AT_PACE) return "on pace";
  return ratio < 2
    ? `${Math.round(100 * (ratio - 1))}\u00a0% too ${way}`
    : `${ratio.toFixed(1)} × too ${way}`;
}

/** Return a number with its sign, a true minus, and no sign for a zero. */
function signed(value, digits) {
  const text = Math.abs(value).toFixed(digits);
  return Number(text) === 0 ? text : `${value < 0 ? "−" : "+"}${text}`;
}

/** Writes the present numbers of a trial into the page. */
export class Readings {
  /** `toggle(clutch)` is called where a person kills a clutch (0 to 3) or repairs it. */
  constructor(clutches, toggle) {
    this.rows = clutches.map(({ name, colour }, k) => {
      const row = byId("clutches").tBodies[0].insertRow();
      const head = Object.assign(document.createElement("th"), { scope: "row" });
      const dot = document.createElement("i");
      dot.style.background = `var(--${colour})`;
      const works = Object.assign(document.createElement("input"), { type: "checkbox" });
      works.setAttribute("aria-label", `clutch ${k + 1} works`);
      works.addEventListener("change", () => toggle(k));
      head.append(works, dot, String(k + 1));
      row.append(head);
      for (let cell = 0; cell < 4; cell++) row.insertCell();
      row.cells[1].textContent = name;
      return row;
    });
  }

  show(trial) {
    const { now, env } = trial;
    byId("time").textContent = now.time.toFixed(2);
    byId("error").textContent = signed(1000 * now.normal_error, 1);
    byId("speed").textContent = env.seen.speed_along.toFixed(2);
    byId("force").textContent = Math.hypot(now.force_x, now.force_y).toFixed(0);
    this.rows.forEach((row, k) => {
      const state = trial.clutch(k);
      row.dataset.state = state;
      const [works] = row.getElementsByTagName("input");
      works.checked = trial.works(k);
      works.disabled = !trial.live;
      row.cells[2].textContent = `${now[`volts_${k + 1}`].toFixed(1)} V`;
      row.cells[3].textContent = `${signed(now[`torque_${k + 1}`], 1)} N·m`;
      row.cells[4].textContent = state;
    });
  }
}

/** All policies under the last push, best first; `replay(policy)` is called with a choice. */
export class Comparison {
  constructor(replay) {
    this.replay = replay;
  }

  clear() {
    byId("comparison").hidden = true;
  }

  /** Show finished trials; `pushed` names the policy under which the person pushed. */
  show(trials, pushed) {
    const ranked = trials.toSorted(
      ({ result: a }, { result: b }) =>
        b.completed - a.completed || a.path_error_m - b.path_error_m,
    );
    byId("comparison").hidden = false;
    const [body] = byId("comparison").querySelector("table").tBodies;
    body.replaceChildren(...ranked.map((trial) => this.#row(trial, pushed)));
  }

  #row({ settings: { policy }, result, ending }, pushed) {
    const row = document.createElement("tr");
    const head = Object.assign(document.createElement("th"), { scope: "row", textContent: policy });
    if (policy === pushed) {
      row.setAttribute("aria-current", "true");
    } else {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", textContent: policy });
      button.addEventListener("click", () => this.replay(policy));
      head.replaceChildren(button);
    }
    row.append(head);
    if (result.completed) {
      row.insertCell().textContent = millimetres(result.path_error_m);
      row.insertCell().textContent = `${result.mean_pace_m_s.toFixed(2)} m/s`;
    } else {
      const cell = Object.assign(row.insertCell(), { colSpan: 2 });
      cell.textContent = ending === "left" ? "left the workspace" : "time ran out";
    }
    return row;
  }
}
