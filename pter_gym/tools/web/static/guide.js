// A guided start of twenty seconds: who brakes, what is said of it, and where the hand that shows it is.

import { DEFAULTS } from "./settings.js";

const still = matchMedia("(prefers-reduced-motion: reduce)");

/** Scenes: { seconds, control, text, hand }; `hand` tells where the hand is [m] from the time and the tip. */
const GUIDE = [
  {
    seconds: 4,
    control: "free",
    text: "1 of 4. Nothing brakes: the handle goes wherever the hand goes. The arrow is the hand’s force.",
    hand: (time, tip, start) => ({ x: start.x + 0.03 * time, y: start.y + 0.16 * Math.sin(2.2 * time) }),
  },
  {
    seconds: 4,
    control: "locked",
    text: "2 of 4. All clutches at 24 V: they lock, and the arm holds however hard the hand pulls.",
    hand: (time, tip, start) => ({ x: start.x + 0.2 * Math.sin(time), y: start.y + 0.16 * Math.sin(2.2 * time) }),
  },
  {
    seconds: 8,
    text: "3 of 4. A controller brakes motion away from the line: clutches glow with their torque and close when they lock.",
    hand: (time, tip) => ({ x: tip.x + 0.13, y: tip.y + 0.1 * Math.sin(2.5 * time) }),
  },
  {
    seconds: 4,
    text: "4 of 4. Your turn: drag the handle along the line to its end, or use the arrow keys.",
    hand: null,
  },
];

/** The guided start on a page; it leaves the settings as they are. */
export class Guide {
  #scene = -1;
  #time = 0;
  #changing = false;

  constructor(page) {
    this.page = page;
    this.ended = false;
  }

  /** Go on to the next scene, or end the page's guide after the last. */
  async next() {
    const scene = GUIDE[++this.#scene];
    if (!scene) {
      this.page.endGuide();
      return;
    }
    this.#changing = true;
    const trial = await this.page.workshop.trial({ ...DEFAULTS, control: scene.control ?? DEFAULTS.other });
    if (this.ended) return;
    this.moves = scene.hand && !still.matches ? scene.hand : null;
    this.start = { x: trial.now.tip_x, y: trial.now.tip_y };
    this.#time = 0;
    this.#changing = false;
    this.page.show([trial]);
    this.page.waiting = !this.moves;
    this.page.say(scene.text);
  }

  /** Let time pass [s]. */
  advance(passed) {
    if (this.#changing) return;
    this.#time += passed;
    if (this.#time >= GUIDE[this.#scene].seconds) this.next();
  }

  /** Where the hand that shows it is [m], or null. */
  hand(tip) {
    return this.moves?.(this.#time, tip, this.start) ?? null;
  }
}
