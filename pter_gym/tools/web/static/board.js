// The scores of trials on this page, best first.

import { save } from "./files.js";
import { format, NAMES, PATHS } from "./settings.js";
import { millimetres, off, tempo } from "./words.js";

const MOST = 8;
const UNRANKED = "†";

/** Shows the results of trials in a table; the newest is marked. */
export class Board {
  #entries = [];
  #newest = null;

  constructor(table, note, button) {
    Object.assign(this, { table, note, button });
  }

  /** Add the result of a trial; `newest` marks it in the table. */
  add(trial, newest = true) {
    const { settings, result, pace } = trial;
    const entry = { settings, result, pace, push: trial.live ? "you" : trial.push ? "your push" : "paper’s push" };
    this.#entries.push(entry);
    if (newest) this.#newest = entry;
    this.#entries.sort((a, b) => b.result.completed - a.result.completed || a.result.path_error_m - b.result.path_error_m);
    const least = this.#entries.length > MOST ? this.#entries.at(this.#entries.at(-1) === this.#newest ? -2 : -1) : null;
    this.#entries = this.#entries.filter((each) => each !== least);
    this.table.hidden = this.button.hidden = false;
    this.note.textContent = "Score: the path error at equal pace, as in the package; lower is better. † Not ranked: the end was not reached.";
    this.table.tBodies[0].replaceChildren(...this.#entries.map((each) => row(each, each === this.#newest)));
  }

  /** Return the best score of a person with some settings [mm], or null. */
  best(settings) {
    const mine = this.#entries.find((each) => each.push === "you" && each.result.completed && format(each.settings) === format(settings));
    return mine ? Number((1000 * mine.result.path_error_m).toFixed(1)) : null;
  }

  /** Save the scores as a picture, beside that of an arm on a canvas. */
  picture(arm, palette, address) {
    const canvas = Object.assign(document.createElement("canvas"), { width: WIDTH, height: HEIGHT });
    const context = canvas.getContext("2d");
    context.fillStyle = palette.stage;
    context.fillRect(0, 0, WIDTH, HEIGHT);
    const scale = Math.min((0.48 * WIDTH) / arm.width, (HEIGHT - 2 * MARGIN) / arm.height);
    context.drawImage(arm, MARGIN, (HEIGHT - scale * arm.height) / 2, scale * arm.width, scale * arm.height);
    const left = 0.54 * WIDTH;
    const write = (text, y, size, colour, weight = 400) => {
      context.font = `${weight} ${size}px system-ui, sans-serif`;
      context.fillStyle = palette[colour];
      context.fillText(text, left, y, WIDTH - left - MARGIN);
    };
    write("PTER, pushed by hand", 90, 38, "ink", 650);
    this.#entries.slice(0, 5).forEach(({ settings, result, pace, push }, k) => {
      const y = 165 + 84 * k;
      const path = `${PATHS[settings.path]}, ${settings.lag} ms, ${push}`;
      write(`${k + 1}. ${NAMES[settings.control]}: ${result.completed ? millimetres(result.path_error_m) : `${UNRANKED} not ranked`}`, y, 28, "ink", 600);
      write(`${result.completed ? `${tempo(result, pace)}, ${off(result)}; ` : ""}${path}`, y + 32, 22, "muted");
    });
    write(address, HEIGHT - MARGIN, 18, "muted");
    canvas.toBlob((blob) => save("scores.png", blob), "image/png");
  }
}

const [WIDTH, HEIGHT, MARGIN] = [1200, 630, 40]; // of the picture [px]

function row({ settings, result, push, pace }, newest) {
  const line = document.createElement("tr");
  const who = document.createElement("th");
  who.scope = "row";
  who.textContent = NAMES[settings.control];
  const path = document.createElement("td");
  path.textContent = PATHS[settings.path];
  const detail = document.createElement("small");
  detail.textContent = `${settings.lag} ms, ${push}`;
  path.append(detail);
  const texts = result.completed ? [off(result).replace(" off", ""), tempo(result, pace), millimetres(result.path_error_m)] : ["", "", UNRANKED];
  const cells = texts.map((text) => Object.assign(document.createElement("td"), { textContent: text }));
  line.append(who, path, ...cells);
  if (newest) line.setAttribute("aria-current", "true");
  return line;
}
