// A trained policy: a law of the module whose gains end with the weights of a network.

import { Law } from "./world.js";

/** Return the float32 tensors in the bytes of a `.safetensors` file, by name. */
export function readTensors(bytes) {
  const buffer = bytes instanceof ArrayBuffer ? bytes : bytes.slice().buffer;
  const begin = 8 + Number(new DataView(buffer).getBigUint64(0, true));
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, begin - 8)));
  const tensors = {};
  for (const [name, { data_offsets: place }] of Object.entries(header)) {
    if (place) tensors[name] = new Float32Array(buffer.slice(begin + place[0], begin + place[1]));
  }
  return tensors;
}

/** Return a layer's gains: its biases, then its weights, input by input. */
function layerOf(weight, bias) {
  const inputs = weight.length / bias.length;
  const at = (k) => weight[(k % bias.length) * inputs + Math.floor(k / bias.length)];
  return [...bias, ...Array.from(weight, (_, k) => at(k))];
}

/** A trained policy: `act(observation)` returns voltages; `reset()` begins a new episode. */
export class Network extends Law {
  /** `card` is an entry of `tables.policies`. */
  constructor(tables, kernels, card, tensors) {
    const layers = card.layers.flatMap((name) =>
      layerOf(tensors[`${name}.weight`], tensors[`${name}.bias`]),
    );
    super(tables, kernels, [...card.gains, ...layers], { memory: card.memory });
    this.period = card.frame_skip;
    this.steps = 0;
  }

  reset() {
    super.reset();
    this.steps = 0;
  }

  /** Return the voltages [V] for an observation, float32: decided now, or held. */
  act(observation) {
    if (this.steps++ % this.period === 0) this.held = super.act(observation);
    return this.held;
  }
}
