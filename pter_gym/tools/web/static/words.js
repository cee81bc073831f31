// What the page says.

import { NAMES } from "./settings.js";

/** Return a length in millimetres and a share in percent, as people read them. */
export const millimetres = (metres) => `${(1000 * metres).toFixed(1)} mm`;
export const percent = (share) => `${Math.round(100 * share)} %`;

/** Return what to do with some settings. */
export function invitation({ control, hand }) {
  if (hand === "paper") return "The push of the paper’s experiments drives the handle.";
  if (control === "free") return "Drag the handle: nobody brakes. Can you follow the line alone?";
  if (control === "locked") return "Drag the handle: all clutches are locked.";
  if (control === "sliders") return "Drag the handle, and brake with the four sliders.";
  return "Drag the handle along the path to its end.";
}

/** Return how a trial ended, in words. */
export function verdict({ ending, result, settings }) {
  const name = `${NAMES[settings.control]}, ${settings.lag} ms`;
  if (ending === "left") return `${name}: the handle left its lane. Take it to begin again.`;
  if (ending === "time") return `${name}: the time is up before the end of the path.`;
  return `${name}: path error ${millimetres(result.path_error_m)} at equal pace, mean pace off by ${percent(result.mean_pace_error)}.`;
}

/** Return what an error says as a sentence. */
export function sentence({ message }) {
  const text = message[0].toUpperCase() + message.slice(1);
  return /[.!?]$/.test(text) ? text : `${text}.`;
}
