// Use the wrapper as a page does and print, as JSON, what tests compare with Python.
//
//   node wrapper.mjs STATIC SHIPPED OBSERVATIONS

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [, , folder, shipped, recorded] = process.argv;
const pter = await import(pathToFileURL(`${folder}/pter.js`));
const tables = JSON.parse(readFileSync(`${folder}/pter.json`));
const simulator = await pter.Simulator.load(readFileSync(`${folder}/pter.wasm`), tables);

/** What a call throws: the name of its kind and its message. */
async function thrown(call) {
  try {
    await call();
  } catch (error) {
    return [error.constructor.name, error.message];
  }
  return null;
}

/** A pointer that wanders along a path, as a person's does: ahead of the tip, and beside it. */
function wander(env, step) {
  const { tip_x, tip_y } = env.telemetry;
  return {
    x: tip_x + 0.15 + 0.1 * Math.sin(0.11 * step),
    y: tip_y + 0.2 * Math.sin(0.07 * step + 1),
  };
}

/** Push a world with a pointer and return its trial, the voltages, and all that came of it. */
async function pushed(settings, name, steps) {
  const env = await simulator.make({ ...settings, hand: "pointer" });
  const law = await simulator.law(name, settings.path);
  const hand = new pter.SpringHand();
  const rows = [];
  let observation = env.reset({ seed: 3 });
  for (let step = 0; step < steps; step++) {
    const volts = law.act(observation);
    const result = env.step(volts, hand.force(env, wander(env, step)));
    observation = result.observation;
    const { reward, telemetry } = result;
    rows.push({
      volts: [...volts],
      observation: [...observation],
      reward,
      telemetry: [...telemetry],
    });
    if (result.terminated || result.truncated) break;
  }
  return { settings, csv: env.trialAsCSV(), trial: env.trial, rows };
}

/** What laws and policies make of recorded observations. */
async function answers() {
  const flat = new Float32Array(new Uint8Array(readFileSync(recorded)).buffer);
  const width = tables.observation.length;
  const observations = Array.from({ length: flat.length / width }, (_, k) =>
    flat.slice(k * width, (k + 1) * width),
  );
  const found = {};
  for (const name of Object.keys(tables.laws)) {
    for (const [scenario, path] of [
      ["standard", "line"],
      ["paths", "sine"],
    ]) {
      const law = await simulator.law(name, path);
      found[`${name}, ${scenario}`] = observations.map((observation) => [...law.act(observation)]);
    }
  }
  for (const name of Object.keys(tables.policies)) {
    const policy = await simulator.policy(name, readFileSync(`${shipped}/${name}.safetensors`));
    found[`${name}, standard`] = observations.map((observation) => [...policy.act(observation)]);
    policy.reset();
    policy.period = 3;
    const { act } = policy.kernels;
    let decisions = 0;
    policy.kernels = { ...policy.kernels, act: (...given) => (decisions++, act(...given)) };
    const held = observations.map((observation) => [...policy.act(observation)]);
    found[`${name}, held`] = { held, decisions };
  }
  return found;
}

/** Mistakes, what they raise, and whether they left the world as it was. */
async function refusals() {
  const env = await simulator.make();
  const early = await thrown(() => env.step([0, 0, 0, 0]));
  env.reset({ seed: 1 });
  env.step([1, 2, 3, 4]);
  const before = JSON.stringify([env.state, env.seen, env.telemetry]);
  const found = {
    early,
    short: await thrown(() => env.step([0, 0, 0])),
    none: await thrown(() => env.step()),
    nan: await thrown(() => env.step([0, NaN, 0, 0])),
    high: await thrown(() => env.step([0, 0, 0, 24.1])),
    low: await thrown(() => env.step([-0.1, 0, 0, 0])),
    force: await thrown(() => env.step([0, 0, 0, 0], { x: 1, y: 0 })),
    seed: await thrown(() => env.reset({ seed: -1 })),
    machine: await thrown(() => simulator.make({ machine: "steel" })),
    path: await thrown(() => simulator.make({ path: "maze" })),
    hand: await thrown(() => simulator.make({ hand: { along: [1, 2], across: [1] } })),
    pace: await thrown(() => simulator.make({ pace: 0 })),
    law: await thrown(() => simulator.law("magic")),
  };
  const pulled = await simulator.make({ hand: "pointer" });
  pulled.reset({ seed: 1 });
  found.pull = await thrown(() => pulled.step([0, 0, 0, 0], { x: NaN, y: 0 }));
  return { found, unchanged: JSON.stringify([env.state, env.seen, env.telemetry]) === before };
}

/** Episodes by their seeds: the first observation of each. */
async function seeds() {
  const first = await simulator.make({ path: "line" });
  const second = await simulator.make({ path: "line" });
  for (const env of [first, second]) {
    env.state.hand.random_phases = env.context.hand.random_phases = 1;
  }
  const begun = [
    first.reset({ seed: 5 }),
    first.reset(),
    second.reset({ seed: 5 }),
    second.reset(),
  ];
  return [...begun, first.reset({ seed: 6 })].map((observation) => [...observation]);
}

/**
 * A minute of wild dragging: the largest power of a clutch [W] and the least of what a step
 * dissipates [J].
 */
async function dragging() {
  const env = await simulator.make({ hand: "pointer", path: "circle" });
  const hand = new pter.SpringHand({ stiffness: 600, damping: 30, limit: 150 });
  const found = { power: -Infinity, dissipated: Infinity, steps: 0, episodes: 0 };
  let alive = false;
  for (let step = 0; step < 6000; step++) {
    if (!alive) {
      env.reset({ seed: step });
      hand.release();
      found.episodes++;
    }
    const pointer = { x: 0.6 * Math.sin(0.031 * step), y: 0.6 + 0.4 * Math.sin(0.043 * step) };
    const volts = [0, 1, 2, 3].map((clutch) => 6 + 6 * Math.sin(0.05 * step * (clutch + 1)));
    const { terminated, truncated } = env.step(volts, hand.force(env, pointer));
    alive = !(terminated || truncated);
    const t = env.telemetry;
    found.power = Math.max(found.power, t.power_1, t.power_2, t.power_3, t.power_4);
    found.dissipated = Math.min(found.dissipated, t.dissipated);
    found.steps++;
  }
  return found;
}

const trial = await pushed({ path: "sine", pace: 0.25 }, "impedance-tuned", 300);
const env = await simulator.make({ path: "circle" });
console.log(
  JSON.stringify({
    trial,
    answers: await answers(),
    refusals: await refusals(),
    seeds: await seeds(),
    dragging: await dragging(),
    points: env.path(9),
    names: {
      seen: Object.keys(env.seen),
      telemetry: Object.keys(env.telemetry),
      state: Object.keys(env.state),
    },
  }),
);
