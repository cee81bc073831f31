// A trial: one episode that a person pushes, or that replays such a push, with all its telemetry.

import { recordingAsCSV, Simulator, SpringHand } from "./pter.js";
import { score } from "./score.js";

const SEED = 1;
const MAX_STEPS = 6000;
const MIN_REPLAY = 300; // control steps
const SLOWEST = 3; // times the duration that the pace asks for, after which a replay ends

/** Makes trials; weights of policies are fetched once. */
export class Workshop {
  #weights = new Map();

  constructor(simulator) {
    this.simulator = simulator;
    this.tables = simulator.tables;
    this.policies = { ...this.tables.laws, ...this.tables.policies };
  }

  static async open() {
    return new Workshop(await Simulator.fetch());
  }

  /**
   * Make a trial with settings of the page.
   *
   * dead      clutches (0 to 3) that give no torque, which `Trial.toggle` changes
   * replayed  what takes the hand's place: `push` { along, across }, and when clutches were
   *           `switched`
   */
  async trial(settings, dead, replayed = null) {
    const push = replayed?.push;
    const { policy, path, machine } = settings;
    const pace = this.tables.paces[settings.pace];
    const maxSteps = push ? this.timeLimit(path, pace, push) : MAX_STEPS;
    const hand = push ?? "pointer";
    const env = await this.simulator.make({ path, machine, pace, maxSteps, hand });
    return new Trial(env, await this.#policy(policy, path), settings, dead, replayed);
  }

  async #policy(name, path) {
    if (Object.hasOwn(this.tables.laws, name)) return this.simulator.law(name, path);
    return this.simulator.policy(name, await this.#fetched(name));
  }

  /** Return a replay's limit: three times what the pace asks for, or what was recorded. */
  timeLimit(path, pace, push) {
    const most = Math.ceil(
      (SLOWEST * this.tables.paths[path].length) / (pace * this.tables.control_period),
    );
    return Math.min(MAX_STEPS, Math.max(MIN_REPLAY, most, push.along.length - 1));
  }

  async #fetched(name) {
    if (!this.#weights.has(name)) {
      const response = await fetch(new URL(`policies/${name}.safetensors`, import.meta.url));
      if (!response.ok) throw new Error(`the policy ${name} cannot be loaded: ${response.status}`);
      this.#weights.set(name, await response.arrayBuffer());
    }
    return this.#weights.get(name);
  }
}

/** One episode. `rows` holds the telemetry from the reset on. */
export class Trial {
  #replayed;

  constructor(env, controller, settings, dead, replayed) {
    Object.assign(this, { env, controller, settings, dead });
    this.#replayed = replayed?.push;
    this.live = replayed === null;
    this.switched = replayed?.switched;
    this.hand = new SpringHand();
    this.period = env.tables.control_period;
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
    this.ended = false;
    this.result = null;
    if (!this.live) return;
    this.switched = [];
    for (const clutch of this.dead) this.#switch(clutch, false);
  }

  /** Return whether a clutch (0 to 3) gives torque. */
  works(clutch) {
    return this.env.state.task.failures.torque[`x${clutch + 1}`] !== 0;
  }

  /** Kill a clutch (0 to 3) in the present and later episodes, or repair it. */
  toggle(clutch) {
    const works = this.dead.delete(clutch);
    if (!works) this.dead.add(clutch);
    this.#switch(clutch, works);
  }

  #switch(clutch, works) {
    this.switched.push({ step: this.rows.length - 1, clutch, works });
    this.#apply({ clutch, works });
  }

  #apply({ clutch, works }) {
    this.env.state.task.failures.torque[`x${clutch + 1}`] = works ? 1 : 0;
  }

  /** The present telemetry, by names. */
  get now() {
    return this.env.telemetry;
  }

  /** The forces of the push, { along, across } [N]. */
  get push() {
    return this.#replayed ?? this.env.trial;
  }

  /** Return point and direction of the path [m] after a time [s] at the commanded pace. */
  paced(time) {
    const last = this.line.length - 1;
    const place = Math.min((last * this.pace * time) / this.env.context.task.path.length, last);
    const k = Math.min(Math.floor(place), last - 1);
    const [from, to] = [this.line[k], this.line[k + 1]];
    const along = [to[0] - from[0], to[1] - from[1]];
    const size = Math.hypot(...along);
    return {
      at: along.map((step, i) => from[i] + (place - k) * step),
      along: along.map((step) => step / size),
    };
  }

  /** Run a replay to its end at once. */
  finish() {
    while (!this.ended) this.step(null);
    return this;
  }

  /** Advance by one control period; `pointer` is { x, y } [m] or null for a hand that lets go. */
  step(pointer) {
    if (!pointer) this.hand.release();
    if (!this.live)
      this.switched.filter(({ step }) => step === this.rows.length - 1).forEach(this.#apply, this);
    const force = this.live && pointer ? this.hand.force(this.env, pointer) : undefined;
    const { observation, ...result } = this.env.step(this.controller.act(this.observation), force);
    this.observation = observation;
    this.rows.push(this.#row());
    if (result.terminated || result.truncated) this.#end(result);
  }

  /** Return a field of a row. */
  at(name, row) {
    return this.rows[row][this.columns[name]];
  }

  /** Return the state of a clutch (0 to 3): dead, released, stuck or slipping. */
  clutch(index) {
    const { mode } = this.now;
    if (!this.works(index)) return "dead";
    if (this.now[`volts_${index + 1}`] === 0 && this.now[`torque_${index + 1}`] === 0)
      return "released";
    return ["ZERO_DOF", `STUCK_${index + 1}`].includes(this.env.tables.modes[mode])
      ? "stuck"
      : "slipping";
  }

  /** Return the push as a CSV file that `pter_gym.hands.read_forces` reads. */
  pushAsCSV() {
    return recordingAsCSV(this.push, this.period);
  }

  /** Return all telemetry as a CSV file, a row for each control step from the reset on. */
  runAsCSV() {
    const names = this.env.tables.telemetry.map(({ name, unit }) => `${name} [${unit}]`);
    return [names.join(","), ...this.rows.map((row) => row.join(",")), ""].join("\n");
  }

  #row() {
    return Float64Array.from(Object.values(this.env.telemetry));
  }

  #end({ terminated, success }) {
    this.ended = true;
    this.ending = success ? "arrived" : terminated ? "left" : "time";
    const fields = ["time", "arc_length", "normal_error", "is_success"];
    const rows = this.rows.map((_, k) =>
      Object.fromEntries(fields.map((name) => [name, this.at(name, k)])),
    );
    const { path, error_max, pace } = this.env.context.task;
    this.result = score(rows, { length: path.length, error_max, pace }, this.env.tables.scoring);
  }
}
