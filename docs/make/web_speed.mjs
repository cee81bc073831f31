// Print the fastest time of a control step in the module [µs], with a law: beginnings of episodes
// of the paper's task.
//
//   node web_speed.mjs STATIC STEPS ROUNDS LAW

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [, , folder, steps, rounds, name] = process.argv;
const { Simulator } = await import(pathToFileURL(`${folder}/pter.js`));
const tables = JSON.parse(readFileSync(`${folder}/pter.json`));
const simulator = await Simulator.load(readFileSync(`${folder}/pter.wasm`), tables);
const env = await simulator.make();
const law = await simulator.law(name);

let fastest = Infinity;
for (let round = 0; round < rounds; round++) {
  let observation = env.reset({ seed: round });
  law.reset();
  const begin = performance.now();
  for (let step = 0; step < steps; step++) ({ observation } = env.step(law.act(observation)));
  fastest = Math.min(fastest, (1000 * (performance.now() - begin)) / steps);
}
console.log(fastest);
