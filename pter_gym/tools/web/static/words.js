// What the page says.

import { NAMES } from "./settings.js";

/** Return a length in millimetres and a share in percent, as people read them. */
export const millimetres = (metres) => `${(1000 * metres).toFixed(1)} mm`;

const AT_PACE = 1.05; // times that the pace may be off and still be called right
const IN_TIMES = 1.5; // from which on it is told as a multiple

/** Return how far the handle was off its path on average, in whole millimetres from 10 mm on. */
export function off({ mean_error_m }) {
  const error = 1000 * mean_error_m;
  return `${error.toFixed(error < 9.95 ? 1 : 0)} mm off`;
}

/** Return how a pace compares with the commanded one [m/s], such as “3 × too slow”. */
export function tempo({ mean_pace_m_s }, pace) {
  if (mean_pace_m_s <= 0) return "never moved";
  const [ratio, way] = mean_pace_m_s < pace ? [pace / mean_pace_m_s, "slow"] : [mean_pace_m_s / pace, "fast"];
  if (ratio < AT_PACE) return "on pace";
  if (ratio < IN_TIMES) return `${Math.round(100 * (ratio - 1))} % too ${way}`;
  return `${ratio.toFixed(ratio < 9.95 && !Number.isInteger(Number(ratio.toFixed(1))) ? 1 : 0)} × too ${way}`;
}

/** Return what to do with some settings. */
export function invitation({ control, hand }) {
  if (hand === "paper") return "The push of the paper’s experiments drives the handle.";
  if (control === "free") return "Drag the handle: nothing brakes it. Can you follow the line on your own?";
  if (control === "locked") return "Drag the handle: all clutches are locked.";
  if (control === "sliders") return "Drag the handle, and brake with the sliders.";
  return "Drag the handle along the path to its end. The small dot beside it moves at the commanded pace.";
}

/** Return how a trial ended, in words. */
export function verdict({ ending, result, settings, pace }) {
  const name = `${NAMES[settings.control]}, ${settings.lag} ms`;
  if (ending === "left") return `${name}: the handle left its lane. Grab it to start again.`;
  if (ending === "time") return `${name}: time ran out before the end of the path.`;
  return `${name}: ${tempo(result, pace)}, ${off(result)} (score ${millimetres(result.path_error_m)}).`;
}

/** Return what an error says as a sentence. */
export function sentence({ message }) {
  const text = message[0].toUpperCase() + message.slice(1);
  return /[.!?]$/.test(text) ? text : `${text}.`;
}
