// The page: push the arm, see what its clutches do, and compare the policies under the same push.

import { Pointer } from "./pointer.js";
import { colours, Scene } from "./scene.js";
import { Comparison, fillSelect, millimetres, Readings, verdict } from "./panel.js";
import { Workshop } from "./trial.js";

const byId = (id) => document.getElementById(id);
const LONGEST_FRAME = 0.1; // [s]; time lost in longer frames is not made up
const FRAMES_PER_READING = 3;
const INVITATION =
  "Drag the handle along the path to its end. The small dot moves at the commanded pace.";
const REPLAY = "This is a replay. Press Again to push the arm yourself.";

class Page {
  settings = { policy: "single-dof-tuned", path: "line", pace: "medium", machine: "baseline" };
  trials = []; // one that a person pushes, or two that replay the same push side by side
  pushed = null; // the last trial that a person finished
  waiting = true; // for the hand, before a trial begins
  dead = new Set(); // clutches that give no torque
  #request = 0;
  #unspent = 0; // time that has passed but has not been simulated [s]
  #lastTime = null;
  #frames = 0;

  async open() {
    this.workshop = await Workshop.open();
    const { tables } = this.workshop;
    this.scenes = [...document.querySelectorAll(".stage canvas")].map(
      (canvas) => new Scene(canvas),
    );
    this.pointer = new Pointer(this.scenes[0], () => this.tip, {
      grab: () => this.grab(),
      key: (key) => key === "r" && (this.again(), true),
    });
    this.readings = new Readings(tables.clutches, (clutch) => this.trials[0].toggle(clutch));
    this.comparison = new Comparison((policy) => this.compare(policy));
    this.palette = colours();
    matchMedia("(prefers-color-scheme: dark)").addEventListener(
      "change",
      () => (this.palette = colours()),
    );
    const { paths: path, paces: pace, machines: machine } = tables;
    for (const [name, choices] of Object.entries({
      policy: this.workshop.policies,
      path,
      pace,
      machine,
    })) {
      fillSelect(byId(name), Object.keys(choices), this.settings[name]);
      byId(name).addEventListener("change", ({ target }) => this.change(name, target.value));
    }
    byId("again").addEventListener("click", () => this.again());
    byId("save-run").addEventListener("click", () => save("run.csv", this.trials[0].runAsCSV()));
    byId("save-push").addEventListener("click", () => save("push.csv", this.trials[0].pushAsCSV()));
    await this.begin();
    requestAnimationFrame((time) => this.frame(time));
  }

  get tip() {
    const { tip_x, tip_y } = this.trials[0].now;
    return { x: tip_x, y: tip_y };
  }

  say(text) {
    byId("caption").textContent = text;
  }

  /** Change a setting and begin again; a comparison stays while its task does. */
  async change(name, value) {
    this.settings = { ...this.settings, [name]: value };
    if (name !== "policy") {
      this.pushed = null;
      this.comparison.clear();
    }
    await this.begin();
  }

  /** Begin with one arm, which a person pushes. */
  begin() {
    return this.show([this.workshop.trial(this.settings, this.dead)], INVITATION);
  }

  /** Begin the present trial again, or leave a comparison. */
  again() {
    if (this.trials.length === 2) return this.begin();
    this.pointer.release();
    this.trials[0].begin();
    this.waiting = true;
    this.say(INVITATION);
    return null;
  }

  /** Replay the last push with the policy that braked it and with another one. */
  compare(policy) {
    byId("stages").scrollIntoView({ block: "nearest" });
    const { settings } = this.pushed;
    const pair = [settings, { ...settings, policy }].map((each) => this.#replay(each));
    return this.show(pair, `Your push again, with ${settings.policy} and with ${policy}.`);
  }

  /** Show trials, which may still be loading, in place of the present ones. */
  async show(loading, text) {
    const request = ++this.#request;
    const trials = await Promise.all(loading);
    if (request !== this.#request) return;
    byId("problem").hidden = true;
    this.pointer.release();
    this.trials = trials;
    this.waiting = trials[0].live;
    byId("stages").classList.toggle("two", trials.length === 2);
    byId("second").hidden = trials.length === 1;
    ["name-first", "name-second"].forEach(
      (id, k) => (byId(id).textContent = trials[k]?.settings.policy ?? ""),
    );
    this.say(text);
  }

  /** Let a hand take the handle; return whether it can. */
  grab() {
    const [trial] = this.trials;
    if (!trial.live) {
      this.say(REPLAY);
      return false;
    }
    if (trial.ended) trial.begin();
    this.waiting = false;
    return true;
  }

  async #finish(trial) {
    if (!trial.live) {
      if (this.trials.every(({ ended }) => ended)) this.say(this.trials.map(verdict).join(" "));
      return;
    }
    this.pointer.release();
    this.say(verdict(trial));
    const { settings, push, switched } = trial;
    const pushed = (this.pushed = { settings, push, switched });
    const replays = Object.keys(this.workshop.policies).map((policy) =>
      this.#replay({ ...settings, policy }),
    );
    const results = (await Promise.all(replays)).map((replay) => replay.finish());
    if (this.pushed === pushed) this.comparison.show(results, settings.policy);
  }

  /** Make a replay of the last push, in which the same clutches fail, with other settings. */
  #replay(settings) {
    return this.workshop.trial(settings, this.dead, this.pushed);
  }

  // --- time ---

  frame(time) {
    const passed =
      this.#lastTime === null ? 0 : Math.min((time - this.#lastTime) / 1000, LONGEST_FRAME);
    this.#lastTime = time;
    const { period } = this.trials[0];
    this.#unspent = this.waiting ? 0 : this.#unspent + passed;
    while (this.#unspent >= period) {
      this.#unspent -= period;
      this.step(period);
    }
    this.draw(this.#unspent / period);
    requestAnimationFrame((next) => this.frame(next));
  }

  step(period) {
    this.pointer.advance(period);
    for (const trial of this.trials) {
      if (trial.ended) continue;
      trial.step(this.pointer.point);
      if (trial.ended) this.#finish(trial);
    }
  }

  draw(part) {
    const { trials, palette, waiting: ready } = this;
    trials.forEach((trial, k) => {
      const pointer = trial.live ? this.pointer.point : null;
      this.scenes[k].draw(trial, { part: trial.ended ? 1 : part, pointer, ready, palette });
    });
    if (this.#frames++ % FRAMES_PER_READING === 0) this.readings.show(trials[0]);
  }
}

/** Let a person save a text as a file. */
function save(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

function complain({ message }) {
  byId("problem").textContent = `Something went wrong: ${message}.`;
  byId("problem").hidden = false;
}

export const page = new Page();
addEventListener("unhandledrejection", ({ reason }) => complain(reason));
try {
  await page.open();
  document.documentElement.dataset.ready = "";
} catch (error) {
  complain(error);
  throw error;
}
