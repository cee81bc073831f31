// The page: one arm that a person pushes, or two that repeat the same push side by side.
import { Board } from "./board.js";
import { Controls } from "./controls.js";
import { readPush, save } from "./files.js";
import { Guide } from "./guide.js";
import { Pointer } from "./pointer.js";
import { Readout } from "./readout.js";
import { colours, Scene } from "./scene.js";
import { beginWith, DEFAULTS, format, NAMES, parse } from "./settings.js";
import { drawTrace } from "./traces.js";
import { Workshop } from "./trial.js";
import { invitation, millimetres, sentence, verdict } from "./words.js";

const byId = (id) => document.getElementById(id);
const LAGS = [10, 200];
const MIN_PUSH = 20; // control steps
const SLOWEST_FRAME = 0.1; // [s]; what a frame takes longer is not caught up
const POINT_SPACING = 0.012; // of a drawn path [m]

class Page {
  settings = { ...DEFAULTS };
  trials = [];
  waiting = true; // for the hand, before a trial begins
  guide = null; // the guided start, while it runs
  stroke = null; // the path that is being drawn; null when none is
  lesson = null; // "Feel the lag": the pushes so far
  push = null; // the last one of this person
  #made = 0;
  #left = 0;
  #last = null;
  #frame = 0;

  async open() {
    this.workshop = await Workshop.open();
    beginWith(this.workshop.tables);
    this.settings = { ...DEFAULTS };
    const canvases = document.querySelectorAll(".stage canvas");
    this.scenes = [...canvases].map((canvas) => new Scene(canvas));
    this.pointer = new Pointer(this.scenes[0], () => this.tip, {
      grab: () => this.grab(),
      key: (key) => key === "r" && (this.again(), true),
    });
    this.controls = new Controls(this.workshop.tables, (name, value) => this.change({ [name]: value }));
    this.readout = new Readout(this.workshop.tables.clutches);
    this.board = new Board(byId("board"), byId("board-note"), byId("save-board"));
    this.palette = colours();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (this.palette = colours()));
    this.#listen();
    await this.followAddress();
    requestAnimationFrame((time) => this.frame(time));
  }

  get tip() {
    const { tip_x, tip_y } = this.trials[0].now;
    return { x: tip_x, y: tip_y };
  }

  say(text) {
    byId("caption").textContent = text;
  }

  /** Show what went wrong; nothing else changes. */
  complain(text) {
    byId("problem").hidden = text === "";
    byId("problem").firstElementChild.textContent = text;
  }

  // --- settings ---

  /** Change settings and begin again; the voltages alone change while the arm moves. */
  async change(changed) {
    this.endGuide();
    if (this.lesson && !("stroke" in changed)) this.lesson = null;
    if ("volts" in changed) {
      this.settings.volts = changed.volts;
      for (const trial of this.trials) trial.settings.volts = changed.volts;
      this.#write();
      return;
    }
    if (changed.path === "drawn" && !this.settings.stroke && !changed.stroke) {
      this.controls.show(this.settings);
      this.startDrawing();
      return;
    }
    if (this.stroke) this.stopDrawing();
    const anew = this.trials.length === 2 || !("other" in changed);
    await this.use({ ...this.settings, ...changed }, anew);
  }

  /** Take settings if they make a trial; otherwise say why not, and keep what there is. */
  async use(settings, anew = true) {
    const before = this.settings;
    try {
      this.settings = settings;
      if (anew) await (this.trials.length === 2 ? this.compare() : this.begin());
      this.complain("");
    } catch (error) {
      this.settings = before;
      this.complain(sentence(error));
    }
    this.controls.show(this.settings);
    this.#write();
  }

  async followAddress() {
    const { settings, problems } = parse(location.hash, this.settings);
    if (this.trials.length === 0) await this.begin(DEFAULTS);
    this.lesson = null;
    await this.use({ ...settings, beat: null }); // told once
    if (settings.beat !== null) this.say(`${invitation(settings)} The score to beat: ${settings.beat.toFixed(1)} mm.`);
    if (problems.length > 0) this.complain(problems.join(" "));
  }

  #write() {
    const hash = format(this.settings);
    if (location.hash.replace(/^#/, "") !== hash) history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
  }

  // --- trials ---

  /** Begin with one arm. */
  async begin(settings = this.settings) {
    const number = ++this.#made;
    const trial = await this.workshop.trial(settings);
    if (number === this.#made) this.show([trial]);
  }

  /** Begin the same trial again. */
  again() {
    this.endGuide();
    this.pointer.release();
    for (const trial of this.trials) trial.begin();
    this.waiting = this.trials.length === 1 && this.trials[0].live;
    if (this.trials.length === 1) this.say(invitation(this.settings));
  }

  /** Two arms under the same push: the last one of this person, or the paper's. */
  async compare(pair = null) {
    const number = ++this.#made;
    const present = this.trials[0];
    if (present?.live && present.rows.length > MIN_PUSH) this.push = present.recording;
    const both = pair ?? [this.settings, { ...this.settings, control: this.settings.other }];
    const trials = await Promise.all(both.map((each) => this.workshop.trial({ ...each, hand: "paper" }, this.push)));
    if (number !== this.#made) return;
    this.show(trials);
    this.say(this.push ? "Your push, repeated for both." : "You haven’t pushed yet, so both get the paper’s push.");
  }

  /** Show one trial, or two side by side, in place of what there is; trials that are still being made are dropped. */
  show(trials) {
    this.#made++;
    this.pointer?.release();
    this.trials = trials;
    this.waiting = trials.length === 1 && trials[0].live;
    const pair = trials.length === 2;
    byId("stages").classList.toggle("two", pair);
    byId("second").hidden = !pair;
    byId("compare").textContent = pair ? "Back to one arm" : "Same push, side by side";
    const title = ({ settings }) => `${NAMES[settings.control]}, ${settings.lag} ms`;
    ["name-first", "name-second"].forEach((id, k) => (byId(id).textContent = trials[k] ? title(trials[k]) : ""));
    byId("save-push").disabled = !(trials[0].live || trials[0].push);
    if (!pair) this.say(invitation(this.settings));
  }

  /** Let a hand take the handle; return whether it can. */
  grab() {
    if (this.guide) {
      this.endGuide();
      return false;
    }
    if (this.stroke) return false;
    const [trial] = this.trials;
    if (this.trials.length === 2 || !trial.live) {
      if (trial.ended) this.say("This push is a recording. To push yourself, choose “You” under “Who pushes”, or go back to one arm.");
      return false;
    }
    if (trial.ended) trial.begin();
    this.waiting = false;
    return true;
  }

  #finish(trial) {
    if (this.guide) return;
    this.board.add(trial);
    if (this.trials.length === 2) {
      if (this.trials.every((each) => each.ended)) this.say(this.trials.map(verdict).join(" "));
      return;
    }
    if (trial.live) this.push = trial.recording;
    this.pointer.release();
    this.say(verdict(trial));
    if (trial.live && trial.result.completed && trial.settings.control !== DEFAULTS.other) this.#ride(trial);
    if (this.lesson) this.#nextLag(trial);
  }

  /** Add to the board what a rival makes of this person's push. */
  async #ride(trial) {
    const rival = await this.workshop.trial({ ...trial.settings, control: DEFAULTS.other, hand: "paper" }, this.push);
    this.board.add(rival.finish(), false);
    if (this.trials[0] === trial && trial.ended) this.say(`${verdict(trial)} On your push, ${verdict(rival)}`);
  }

  // --- feel the lag ---

  /** The same path by hand at a short and at a long time constant, then both side by side. */
  async feel() {
    this.endGuide();
    const law = ["free", "locked", "sliders"].includes(this.settings.control) ? DEFAULTS.control : this.settings.control;
    this.show(this.trials.slice(0, 1));
    await this.use({ ...this.settings, control: law, hand: "you", lag: LAGS[0] });
    this.lesson = [];
    this.say(`Clutches that follow within ${LAGS[0]} ms. Drag the handle along the path to its end.`);
  }

  async #nextLag(trial) {
    const told = trial.ending === "arrived" ? millimetres(trial.result.path_error_m) : "the lane was left";
    const { lesson } = this;
    lesson.push({ told, push: trial.recording });
    if (lesson.length < LAGS.length) {
      await this.use({ ...this.settings, lag: LAGS[lesson.length] });
      this.lesson = lesson;
      this.say(`${LAGS[0]} ms: ${told}. Now the same path with ${LAGS[1]} ms: every brake acts late.`);
      return;
    }
    this.lesson = null;
    this.push = lesson[0].push;
    await this.compare(LAGS.map((lag) => ({ ...this.settings, lag })));
    this.say(`${LAGS.map((lag, k) => `${lag} ms: ${lesson[k].told}`).join(". ")}. Here is your first push with both.`);
  }

  // --- the guided start ---

  async startGuide() {
    if (this.guide) {
      this.endGuide();
      return;
    }
    if (this.stroke) this.stopDrawing();
    this.lesson = null;
    this.guide = new Guide(this);
    byId("guide").textContent = "End the tour";
    await this.guide.next();
  }

  /** Leave the guided start for the settings of before, if it runs. */
  endGuide() {
    if (!this.guide) return;
    this.guide.ended = true;
    this.guide = null;
    byId("guide").textContent = "Show me, 20 s";
    this.begin();
  }

  // --- a path drawn by hand ---

  startDrawing() {
    this.endGuide();
    this.pointer.release();
    this.stroke = [];
    byId("draw").setAttribute("aria-pressed", "true");
    this.scenes[0].canvas.classList.add("drawing");
    this.say("Draw a path within the circle that the arm can reach: press, draw one line, let go.");
  }

  stopDrawing() {
    this.stroke = null;
    byId("draw").setAttribute("aria-pressed", "false");
    this.scenes[0].canvas.classList.remove("drawing");
    if (this.trials.length === 1) this.say(invitation(this.settings));
  }

  #drawOn(event) {
    if (!this.stroke || event.buttons !== 1) return;
    const { x, y } = this.scenes[0].world(event);
    const last = this.stroke.at(-1);
    if (!last || Math.hypot(x - last[0], y - last[1]) >= POINT_SPACING) this.stroke.push([x, y].map((part) => Math.round(1000 * part) / 1000));
  }

  async #drawn() {
    if (!this.stroke?.length) return;
    const { stroke } = this;
    this.stopDrawing();
    await this.use({ ...this.settings, path: "drawn", stroke });
  }

  // --- files ---

  /** Repeat the push in a file. */
  async openPush(file) {
    if (!file) return;
    await this.attempt(async () => {
      const push = readPush(await file.text(), this.workshop.tables.control_period);
      const trial = await this.workshop.trial(this.settings, push);
      this.endGuide();
      this.push = push;
      this.show([trial]);
      this.say(`The push in ${file.name}, ${((push.along.length - 1) * trial.period).toFixed(1)} s.`);
    });
  }

  async share() {
    const beat = this.board.best(this.settings);
    const link = new URL(location.href);
    link.hash = format({ ...this.settings, beat });
    const what = `link to these settings${beat === null ? "" : `, with your ${beat.toFixed(1)} mm to beat,`}`;
    try {
      await navigator.clipboard.writeText(link.href);
      this.say(`The ${what} is on the clipboard.`);
    } catch {
      this.say(`The ${what.replace(/,$/, "")}: ${link.href}`);
    }
  }

  // --- time ---

  frame(time) {
    const passed = this.#last === null ? 0 : Math.min((time - this.#last) / 1000, SLOWEST_FRAME);
    this.#last = time;
    const { period } = this.trials[0];
    this.#left = this.waiting ? 0 : this.#left + passed;
    while (this.#left >= period) {
      this.#left -= period;
      this.step(period);
    }
    this.guide?.advance(passed);
    this.draw(this.#left / period);
    requestAnimationFrame((next) => this.frame(next));
  }

  step(period) {
    this.pointer.advance(period);
    for (const trial of this.trials) {
      if (trial.ended) continue;
      trial.step(this.hand);
      if (trial.ended) this.#finish(trial);
    }
  }

  /** Where the hand is [m], or null. */
  get hand() {
    return this.guide ? this.guide.hand(this.tip) : this.pointer.point;
  }

  draw(part) {
    const { trials, palette, stroke } = this;
    const ready = this.waiting && !stroke;
    trials.forEach((trial, k) => {
      const pointer = trial.live ? this.hand : null;
      this.scenes[k].draw(trial, { part: trial.ended ? 1 : part, pointer, stroke: k === 0 ? stroke : null, ready, palette });
    });
    if (this.#frame++ % 3) return;
    this.readout.show(trials[0]);
    for (const canvas of document.querySelectorAll("[data-trace]")) drawTrace(canvas, canvas.dataset.trace, trials[0], trials[1], palette);
  }

  #listen() {
    const clicks = {
      again: () => this.again(),
      guide: () => this.startGuide(),
      feel: () => this.feel(),
      draw: () => (this.stroke ? this.stopDrawing() : this.startDrawing()),
      compare: () => this.#toggleCompare(),
      share: () => this.share(),
      "save-board": () => this.board.picture(this.scenes[0].canvas, this.palette, location.href.replace(/^https?:\/\//, "")),
      "save-push": () => save("push.csv", this.trials[0].pushAsCSV()),
      "save-record": () => save("record.csv", this.trials[0].recordAsCSV()),
      "open-push": () => byId("file").click(),
    };
    for (const [id, does] of Object.entries(clicks)) byId(id).addEventListener("click", does);
    byId("problem").lastElementChild.addEventListener("click", () => this.complain(""));
    byId("file").addEventListener("change", async (event) => {
      await this.openPush(event.target.files[0]);
      event.target.value = "";
    });
    const [{ canvas }] = this.scenes;
    canvas.addEventListener("pointerdown", (event) => this.#drawOn(event));
    canvas.addEventListener("pointermove", (event) => this.#drawOn(event));
    canvas.addEventListener("pointerup", () => this.#drawn());
    addEventListener("hashchange", () => this.followAddress());
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => {
      event.preventDefault();
      this.openPush(event.dataTransfer.files[0]);
    });
    addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      this.endGuide();
      if (this.stroke) this.stopDrawing();
    });
  }

  async #toggleCompare() {
    this.endGuide();
    await this.attempt(() => (this.trials.length === 2 ? this.begin() : this.compare()));
  }

  /** Do something, or say why it cannot be done. */
  async attempt(does) {
    try {
      await does();
      this.complain("");
    } catch (error) {
      this.complain(sentence(error));
    }
  }
}

export const page = new Page();
try {
  await page.open();
  document.documentElement.dataset.ready = "";
} catch (error) {
  page.complain(`The simulator cannot be loaded. ${sentence(error)}`);
  throw error;
}
