// The scores of trials on this page, best first.

import { NAMES, PATHS } from "./settings.js";
import { millimetres, percent } from "./words.js";

const MOST = 8;

/** Shows the results of trials in a table; the newest is marked. */
export class Board {
  #entries = [];

  constructor(table, note) {
    Object.assign(this, { table, note });
  }

  add(trial) {
    const entry = { settings: trial.settings, result: trial.result, push: trial.live ? "you" : trial.push ? "repeated" : "paper" };
    this.#entries.push(entry);
    this.#entries.sort((a, b) => b.result.completed - a.result.completed || a.result.path_error_m - b.result.path_error_m);
    const least = this.#entries.length > MOST ? this.#entries.at(this.#entries.at(-1) === entry ? -2 : -1) : null;
    this.#entries = this.#entries.filter((each) => each !== least);
    this.table.hidden = false;
    this.note.textContent = "Path error at equal pace, as the package scores it; a pace error above 15 % has no rank there.";
    this.table.tBodies[0].replaceChildren(...this.#entries.map((each) => row(each, each === entry)));
  }
}

function row({ settings, result, push }, newest) {
  const line = document.createElement("tr");
  const who = document.createElement("th");
  who.scope = "row";
  who.textContent = NAMES[settings.control];
  const path = document.createElement("td");
  path.textContent = PATHS[settings.path];
  const detail = document.createElement("small");
  detail.textContent = `${settings.lag} ms, ${push}`;
  path.append(detail);
  const error = document.createElement("td");
  error.textContent = result.completed ? millimetres(result.path_error_m) : "not done";
  const pace = document.createElement("td");
  pace.textContent = percent(result.mean_pace_error);
  line.append(who, path, error, pace);
  if (newest) line.setAttribute("aria-current", "true");
  return line;
}
