// The package's kernels (pter.wasm) behind the contract of the Python environment.
//
//   const simulator = await Simulator.fetch();
//   const env = await simulator.make({ path: "sine", hand: "pointer", pace: 0.25 });
//   const law = await simulator.law("impedance");
//   const hand = new SpringHand({ stiffness: 300, damping: 15, limit: 60 });
//   let observation = env.reset({ seed: 1 });
//   let ended = false;
//   while (!ended) {
//     const result = env.step(law.act(observation), hand.force(env, pointer));
//     observation = result.observation;
//     ended = result.terminated || result.truncated;
//     draw(env.telemetry.tip_x, env.telemetry.torque_1, env.seen.speed_along);
//   }
//
// All numbers are in SI. Names, places and scales are those of pter.json, which the package's
// declarations make.

import { Network, readTensors } from "./network.js";
import { fill, inUnits, Law, named, World } from "./world.js";

export { Law, Network, World };

/** An argument that is unknown or out of range; nothing has changed. */
export class ParameterError extends RangeError {}

/** Voltages that are not four finite numbers within the bounds; nothing has moved. */
export class ActionError extends RangeError {}

/** A step before the first reset or after the end of an episode; nothing has moved. */
export class ResetNeededError extends Error {}

const DEFAULTS = {
  machine: "baseline",
  path: "line",
  hand: "paper",
  pace: 0.25,
  maxSteps: Infinity,
};

/** The module and its tables, from which environments, laws and policies are made. */
export class Simulator {
  constructor(module, tables) {
    this.module = module;
    this.tables = tables;
  }

  /** Load `pter.wasm` and `pter.json` from a folder, by default that of this file. */
  static async fetch(folder = new URL(".", import.meta.url)) {
    const [module, tables] = await Promise.all(
      ["pter.wasm", "pter.json"].map((name) => get(new URL(name, folder))),
    );
    return Simulator.load(await module.arrayBuffer(), await tables.json());
  }

  /** Make a simulator of the module's bytes and the parsed tables. */
  static async load(bytes, tables) {
    return new Simulator(await WebAssembly.compile(bytes), tables);
  }

  /**
   * Make an environment.
   *
   * machine   a name in `tables.machines`
   * path      a name in `tables.paths`
   * hand      "paper": a push along the path and sines across it; "pointer": the force that `step`
   *           gets; or `{ along, across }`: forces [N] at the control instants, as `trial` has them
   * pace      commanded mean speed along the path [m/s]
   * maxSteps  control steps after which an episode is truncated
   */
  async make(settings = {}) {
    return new Environment(this.tables, await this.kernels(), { ...DEFAULTS, ...settings });
  }

  /** Make a law by its name in `tables.laws`, with the gains for a path. */
  async law(name, path = "line") {
    const gains = find(this.tables.laws, "law", name);
    return new Law(
      this.tables,
      await this.kernels(),
      path === "line" ? gains.standard : gains.paths,
    );
  }

  /** Make a trained policy by its name in `tables.policies` and the bytes of its `.safetensors`. */
  async policy(name, weights) {
    const card = find(this.tables.policies, "policy", name);
    return new Network(this.tables, await this.kernels(), card, readTensors(weights));
  }

  /** Return the module's functions with a memory of their own. */
  async kernels() {
    return (await WebAssembly.instantiate(this.module)).exports;
  }
}

/**
 * One world: what `PTER/PathFollowing-v0` with all sensors and voltages as actions is in Python.
 *
 * `seen` reads the last observation and `telemetry` the last telemetry by the names of their
 * fields, in their units; `state` reads and writes all numbers of the world by the names of the
 * package's record `World`. All three are live. With the hand "pointer", `trial` holds the forces
 * of the episode so far, which `trialAsCSV` writes.
 */
export class Environment {
  #world;
  #seeded = false;

  constructor(tables, kernels, settings) {
    this.tables = tables;
    this.settings = settings;
    this.machine = find(tables.machines, "machine", settings.machine);
    this.#world = new World(tables, kernels, arraysOf(tables, settings));
    this.context = named(tables.places.context, this.#world.constants);
    this.state = this.#world.state;
    this.seen = inUnits(tables.observation, this.#world.observation);
    this.telemetry = inUnits(tables.telemetry, this.#world.telemetry);
  }

  /** Start an episode, without a seed the next one; return its first observation. */
  reset({ seed } = {}) {
    const given = seed !== undefined;
    check(
      !given || (Number.isSafeInteger(seed) && seed >= 0),
      "seed",
      seed,
      "a whole number from 0 on",
    );
    const [present, episode] = this.#world.words;
    this.trial = { along: [0], across: [0] };
    if (this.settings.hand === "pointer") this.#write([0, 0, 0, 0]);
    if (given) this.#world.reset(BigInt(seed), 0n);
    else if (this.#seeded) this.#world.reset(present, episode + 1n);
    else this.#world.reset(crypto.getRandomValues(new BigUint64Array(1))[0], 0n);
    this.#seeded = true;
    return this.#world.observation.slice();
  }

  /**
   * Advance by one control period.
   *
   * volts  the voltages of the four clutches [V], those that the machine does not have included
   * force  with the hand "pointer", the force { x, y } on the tip [N] at the end of the period, to
   *        which it ramps along and across the path; none by default
   *
   * Returns observation (float32), reward, terminated, truncated, success and telemetry (float64).
   */
  step(volts, force) {
    if (this.state.alive === 0) {
      throw new ResetNeededError("a reset is needed: none came before, or the episode has ended");
    }
    if (volts?.length !== 4) throw new ActionError(`volts must be four numbers, got ${volts}`);
    const pushed = this.#push(force);
    this.#world.volts.set(volts);
    if (this.#world.step()) {
      throw new ActionError(
        `volts must be finite and within [0, ${this.machine.voltage_max}], got ${[...volts]}`,
      );
    }
    if (pushed) {
      this.trial.along.push(pushed.along);
      this.trial.across.push(pushed.across);
    }
    const { terminated, truncated, success } = this.state.end;
    return {
      observation: this.#world.observation.slice(),
      reward: this.state.reward,
      terminated: terminated !== 0,
      truncated: truncated !== 0,
      success: success !== 0,
      telemetry: this.#world.telemetry.slice(),
    };
  }

  /** Return points [x, y] of the path at even arc lengths from its start to its end [m]. */
  path(count = 101) {
    const { path } = this.context.task;
    return Array.from({ length: count }, (_, k) =>
      this.#world.pointAt(path, (path.length * k) / (count - 1)),
    );
  }

  /** Return the trial as a CSV file: a recording that `pter_gym.hands.read_forces` reads. */
  trialAsCSV() {
    return recordingAsCSV(this.trial, this.tables.control_period);
  }

  /** Write the pointer's force to the hand's recording, and return it along the path. */
  #push(force) {
    check(
      !force || this.settings.hand === "pointer",
      "force",
      force,
      'none, unless the hand is "pointer"',
    );
    if (this.settings.hand !== "pointer") return null;
    const { x, y } = force ?? { x: 0, y: 0 };
    check(Number.isFinite(x) && Number.isFinite(y), "force", [x, y], "{ x, y } of finite numbers");
    const { cos, sin } = this.state.foot.heading;
    const next = { along: x * cos + y * sin, across: y * cos - x * sin };
    this.#write([this.trial.along.at(-1), this.trial.across.at(-1), next.along, next.across]);
    const { step } = this.state;
    this.state.hand.record_first =
      this.context.hand.record_first - this.tables.widths.instant * step;
    this.state.hand.record_count = step + 2;
    return next;
  }

  /** Write the forces at the present and the next instant, all that a recording holds. */
  #write(forces) {
    this.#world.constants.set(forces, this.context.hand.record_first);
  }
}

/** Return forces { along, across } [N] at the control instants as a CSV file. */
export function recordingAsCSV({ along, across }, period) {
  const rows = along.map((force, k) => `${k * period},${force},${across[k]}`);
  return ["time,along,across", ...rows, ""].join("\n");
}

/** A hand on a pointer: spring and damper, up to a largest force [N/m, N·s/m, N]. */
export class SpringHand {
  constructor({ stiffness = 300, damping = 15, limit = 60 } = {}) {
    Object.assign(this, { stiffness, damping, limit });
    this.release();
  }

  /** Let go: the pointer is somewhere else when it comes back. */
  release() {
    this.last = null;
  }

  /** Return the force on the tip [N] for a pointer { x, y } [m], once in each control step. */
  force(env, pointer) {
    const { tip_x, tip_y, tip_velocity_x, tip_velocity_y } = env.telemetry;
    const before = this.last ?? pointer;
    this.last = { ...pointer };
    const speed = (now, then) => (now - then) / env.tables.control_period;
    const x =
      this.stiffness * (pointer.x - tip_x) +
      this.damping * (speed(pointer.x, before.x) - tip_velocity_x);
    const y =
      this.stiffness * (pointer.y - tip_y) +
      this.damping * (speed(pointer.y, before.y) - tip_velocity_y);
    const part = Math.min(1, this.limit / Math.hypot(x, y));
    return { x: part * x, y: part * y };
  }
}

/** Return the arrays of a world with some settings. */
function arraysOf(tables, settings) {
  const { places, widths } = tables;
  const machine = find(tables.machines, "machine", settings.machine);
  const path = find(tables.paths, "path", settings.path);
  const hand =
    typeof settings.hand === "string"
      ? find(tables.hands, "hand", settings.hand)
      : tables.hands.pointer;
  const { pace, maxSteps } = settings;
  check(pace > 0 && pace <= 5, "pace", pace, "within (0, 5] m/s");
  check(maxSteps >= 1, "maxSteps", maxSteps, "at least 1");
  const arcs = path.arcs.flat();
  const recording = recorded(settings.hand, widths.instant);
  const constants = new Float64Array(widths.context + arcs.length + recording.length);
  const context = {
    machine,
    hand: { ...hand, record_first: widths.context + arcs.length },
    task: {
      ...tables.task,
      path: { first: widths.context, arcs: path.arcs.length, length: path.length },
      pace,
      error_max: path.error_max,
    },
    told: { ...tables.told[settings.machine], hand_push: hand.push },
    arrangement: tables.arrangement,
  };
  if (typeof settings.hand !== "string") context.hand.record_count = settings.hand.along.length;
  fill(places.context, context, constants);
  constants.set(arcs, widths.context);
  constants.set(recording, widths.context + arcs.length);
  const config = Float64Array.from(tables.config);
  config[places.config.max_steps] = maxSteps;
  const guides = hand.record_count > 0;
  return { config, constants, entries: tables.observation.length, draws: 1, guides };
}

/** Return the forces of a recording at its control instants; two without any, for a pointer. */
function recorded(hand, instant) {
  if (hand === "pointer") return new Array(2 * instant).fill(0);
  if (typeof hand === "string") return [];
  const { along, across } = hand;
  const forces = Array.from(along ?? [], (force, k) => [force, across?.[k]]).flat();
  const fits =
    forces.length > 0 && along.length === across?.length && forces.every(Number.isFinite);
  check(fits, "hand", "a recording", "forces along and across of one length, all finite");
  return forces;
}

function find(table, what, name) {
  check(Object.hasOwn(table, name), what, name, `one of ${Object.keys(table).join(", ")}`);
  return table[name];
}

function check(holds, what, value, accepted) {
  if (!holds)
    throw new ParameterError(`${what} must be ${accepted}, got ${JSON.stringify(value) ?? value}`);
}

async function get(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url} cannot be loaded: ${response.status}`);
  return response;
}
