// A trial: one episode with who brakes and who pushes, and all that is recorded of it.

import { Simulator, SpringHand } from "./pter.js";
import { score } from "./score.js";

const SEED = 1;
const MAX_STEPS = 6000;

/** Voltages that a person sets. */
class Sliders {
  constructor(settings) {
    this.settings = settings;
  }

  reset() {}

  act() {
    return this.settings.volts;
  }
}

/** Makes trials; weights of policies are fetched once. */
export class Workshop {
  #weights = new Map();

  constructor(simulator) {
    this.simulator = simulator;
    this.tables = simulator.tables;
  }

  static async open() {
    return new Workshop(await Simulator.fetch());
  }

  /** Make who brakes by a name of `settings.control`. */
  async controller(settings) {
    const { control, path } = settings;
    if (control === "sliders") return new Sliders(settings);
    if (!Object.hasOwn(this.tables.policies, control)) return this.simulator.law(control, path);
    return this.simulator.policy(control, await this.#weightsOf(control));
  }

  /** Make a trial with settings of the page; `push` is a recording { along, across } that takes the hand's place. */
  async trial(settings, push = null) {
    const { stroke, path, pace, material, lag, friction } = settings;
    const hand = push ?? (settings.hand === "you" ? "pointer" : "paper");
    const env = await this.simulator.make({
      path: path === "drawn" ? await this.simulator.draw(stroke, material) : path,
      hand,
      pace: this.tables.paces[pace],
      machine: material,
      timeConstant: lag / 1000,
      friction,
      maxSteps: hand === "pointer" ? MAX_STEPS : this.timeLimit(settings, push),
    });
    const own = { ...settings };
    return new Trial(env, await this.controller(own), own, push);
  }

  /** Return the control steps that a push may take: three times what the pace needs, or what was recorded. */
  timeLimit({ path, pace }, push) {
    const length = this.tables.paths[path]?.length ?? 1;
    const most = Math.ceil((3 * length) / (this.tables.paces[pace] * this.tables.control_period));
    return Math.min(MAX_STEPS, Math.max(300, most, push ? push.along.length - 1 : 0));
  }

  async #weightsOf(name) {
    if (!this.#weights.has(name)) {
      const response = await fetch(new URL(`policies/${name}.safetensors`, import.meta.url));
      if (!response.ok) throw new Error(`The policy ${name} cannot be loaded: ${response.status}.`);
      this.#weights.set(name, await response.arrayBuffer());
    }
    return this.#weights.get(name);
  }
}

/** One episode. `rows` holds the telemetry from the reset on, `ledger` the energies up to each row [J]. */
export class Trial {
  constructor(env, controller, settings, push) {
    Object.assign(this, { env, controller, settings, push });
    this.hand = new SpringHand();
    this.period = env.tables.control_period;
    this.live = env.settings.hand === "pointer";
    this.pace = env.context.task.pace;
    this.line = env.path(201);
    this.columns = Object.fromEntries(env.tables.telemetry.map(({ name }, k) => [name, k]));
    this.begin();
  }

  /** Begin the episode again. */
  begin() {
    this.controller.reset();
    this.hand.release();
    this.observation = this.env.reset({ seed: SEED });
    this.rows = [this.#row()];
    this.ledger = [{ hand: 0, clutches: 0, rounding: 0, kinetic: this.now.kinetic_energy }];
    this.given = 0;
    this.ended = false;
    this.result = null;
  }

  /** The present telemetry, by names. */
  get now() {
    return this.env.telemetry;
  }

  /** Where the tip should be [m] after a time [s] at the commanded pace, with the direction of the path there. */
  paced(time) {
    const last = this.line.length - 1;
    const place = Math.min((last * this.pace * time) / this.env.context.task.path.length, last);
    const k = Math.min(Math.floor(place), last - 1);
    const [from, to] = [this.line[k], this.line[k + 1]];
    const along = [to[0] - from[0], to[1] - from[1]];
    const size = Math.hypot(...along);
    return { at: along.map((step, i) => from[i] + (place - k) * step), along: along.map((step) => step / size) };
  }

  /** Run to the end at once; only a push that is repeated has one. */
  finish() {
    while (!this.ended) this.step(null);
    return this;
  }

  /** Advance by one control period; `pointer` is { x, y } [m] or null for a hand that lets go. */
  step(pointer) {
    if (this.ended) return;
    if (!pointer) this.hand.release();
    const force = this.live && pointer ? this.hand.force(this.env, pointer) : undefined;
    const result = this.env.step(this.controller.act(this.observation), force);
    this.observation = result.observation;
    this.rows.push(this.#row());
    this.#account();
    if (result.terminated || result.truncated) this.#end(result);
  }

  /** Return a field of a row, by default the last one. */
  at(name, row = this.rows.length - 1) {
    return this.rows[row][this.columns[name]];
  }

  /** Return how a clutch (0 to 3) is: released, stuck or slipping. */
  clutch(index) {
    const { mode } = this.now;
    if (this.now[`volts_${index + 1}`] === 0 && this.now[`torque_${index + 1}`] === 0) return "released";
    return mode === 5 || mode - 1 === this.env.tables.clutches[index].line ? "stuck" : "slipping";
  }

  /** The largest torque that a clutch can have [N·m]. */
  get torqueLimit() {
    const { breakaway, dynamic, scale, voltage_max } = this.env.context.machine;
    const torque = ({ slope, knee, curvature }) =>
      slope * voltage_max + curvature * Math.max(voltage_max - knee, 0) ** 2;
    return scale.x1 * Math.max(torque(breakaway), torque(dynamic));
  }

  /** The forces of the push so far, { along, across } [N]; null where nobody recorded them. */
  get recording() {
    return this.push ?? (this.live ? this.env.trial : null);
  }

  /** Return the push as a CSV file that `pter_gym.hands.read_forces` reads. */
  pushAsCSV() {
    if (this.live) return this.env.trialAsCSV();
    const { along, across } = this.push;
    const rows = along.map((force, k) => `${k * this.period},${force},${across[k]}`);
    return ["time,along,across", ...rows, ""].join("\n");
  }

  /** Return all telemetry as a CSV file, a row for each control step from the reset on. */
  recordAsCSV() {
    const names = this.env.tables.telemetry.map(({ name, unit }) => `${name} [${unit}]`);
    return [names.join(","), ...this.rows.map((row) => row.join(",")), ""].join("\n");
  }

  #row() {
    return Float64Array.from(Object.values(this.env.telemetry));
  }

  #account() {
    const { hand_work, dissipated, numerical_loss, residual, kinetic_energy } = this.now;
    const before = this.ledger.at(-1);
    this.ledger.push({
      hand: before.hand + hand_work,
      clutches: before.clutches + dissipated,
      rounding: before.rounding + numerical_loss - residual,
      kinetic: kinetic_energy,
    });
    const power = Math.max(this.now.power_1, this.now.power_2, this.now.power_3, this.now.power_4);
    this.given = Math.max(this.given, power * this.period, -dissipated);
  }

  #end({ terminated, success }) {
    this.ended = true;
    this.ending = success ? "arrived" : terminated ? "left" : "time";
    const fields = ["time", "arc_length", "normal_error", "is_success"];
    const rows = this.rows.map((_, k) => Object.fromEntries(fields.map((name) => [name, this.at(name, k)])));
    const { path, error_max, pace } = this.env.context.task;
    this.result = score(rows, { length: path.length, error_max, pace }, this.env.tables.scoring);
  }
}
