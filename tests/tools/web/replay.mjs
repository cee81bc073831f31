// Step the worlds of native.py in the module and print, as JSON, where its bits are others.
//
//   node replay.mjs STATIC FOLDER

import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [, , folder, runs] = process.argv;
const { Law, Simulator, World } = await import(pathToFileURL(`${folder}/pter.js`));
const tables = JSON.parse(readFileSync(`${folder}/pter.json`));
const simulator = await Simulator.load(readFileSync(`${folder}/pter.wasm`), tables);

const numbers = (name) => new Float64Array(new Uint8Array(readFileSync(`${runs}/${name}`)).buffer);
const report = { steps: 0, seconds: 0, episodes: 0, different: [] };

for (const run of JSON.parse(readFileSync(`${runs}/runs.json`))) {
  const constants = numbers(`${run.name}.constants`);
  const actions = numbers(`${run.name}.actions`);
  for (let index = 0; index < run.worlds; index++) {
    const world = new World(tables, await simulator.kernels(), { ...run, constants });
    const gains = run.gains[index];
    const law = gains && new Law(tables, await simulator.kernels(), gains, { scales: run.scales });
    const ends = world.state.end;
    const stored = world.numbers.subarray(0, run.rows);
    const begin = performance.now();
    world.reset(BigInt(index + 1), 0n);
    let hash = createHash("sha256");
    for (let step = 0; step < run.steps; step++) {
      const at = 4 * (run.worlds * step + index);
      const given = actions.subarray(at, at + 4);
      world.volts.set(law ? law.act(world.observation) : given);
      if (world.volts.some((volts, k) => !Object.is(volts, given[k]))) {
        report.different.push(`${run.name}, world ${index}, step ${step}: the law's voltages`);
        break;
      }
      if (world.step()) throw new Error(`${run.name}, world ${index}, step ${step} is refused`);
      const flags = [ends.terminated, ends.truncated, ends.success];
      const { reward } = world.state;
      if (flags[0] || flags[1]) {
        hash.update(world.observation).update(world.telemetry);
        world.reset(world.words[0], world.words[1] + 1n);
        report.episodes++;
      }
      hash
        .update(world.observation)
        .update(new Float64Array([reward]))
        .update(new Uint8Array(flags));
      hash.update(stored).update(world.telemetry);
      report.steps++;
      if ((step + 1) % run.chunk === 0) {
        const chunk = (step + 1) / run.chunk - 1;
        if (hash.digest("hex") !== run.hashes[chunk][index]) {
          report.different.push(`${run.name}, world ${index}, the steps up to ${step + 1}`);
          break;
        }
        hash = createHash("sha256");
      }
    }
    report.seconds += (performance.now() - begin) / 1000;
  }
}
console.log(JSON.stringify(report));
