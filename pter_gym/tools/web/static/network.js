// A trained policy in JavaScript: what its network sees, the layers, and how their outputs become voltages.

/** Inputs of a network are limited to ±LIMIT of their scales. */
const LIMIT = 10;

const limited = (value, low, high) => Math.min(Math.max(value, low), high);

/** Quantities that are derived from those of an observation. */
const DERIVED = Object.fromEntries(
  ["a", "b"].flatMap((link) => [
    [`heading_${link}_cos`, (q) => q.heading_cos * q[`cos_${link}`] + q.heading_sin * q[`sin_${link}`]],
    [`heading_${link}_sin`, (q) => q.heading_sin * q[`cos_${link}`] - q.heading_cos * q[`sin_${link}`]],
  ]),
);

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

/** A trained policy: `act(observation)` returns voltages; `reset()` begins a new episode. */
export class Network {
  /** `card` is an entry of `tables.policies`, `base` the law that its outputs correct or null. */
  constructor(tables, card, tensors, base) {
    this.fields = tables.observation;
    this.card = card;
    this.base = base;
    this.layers = Object.keys(card.shapes)
      .filter((name) => name.endsWith(".weight"))
      .map((name) => [tensors[name], tensors[name.replace("weight", "bias")]]);
    this.reset();
  }

  reset() {
    this.base?.reset();
    this.seen = [];
    this.means = [];
    this.steps = 0;
  }

  /** Return the voltages [V] for an observation, float32: decided now, or held. */
  act(observation) {
    if (this.steps++ % this.card.frame_skip === 0) this.held = this.decide(observation);
    return this.held;
  }

  /** Return what the network decides, voltages [V], float32. */
  decide(observation) {
    const corrected = this.base ? this.base.act(observation) : new Array(4).fill(0.5 * this.card.voltage_max);
    const outputs = this.outputs(this.inputs(observation, corrected));
    return Float32Array.from(outputs, (output, clutch) => this.volts(limited(output, -1, 1), corrected[clutch]));
  }

  /** Return the inputs of now, of earlier control steps and on average. */
  inputs(observation, corrected) {
    const { inputs, history, averages } = this.card;
    const q = Object.fromEntries(this.fields.map(({ name, scale }, index) => [name, observation[index] * scale]));
    for (const [name, derive] of Object.entries(DERIVED)) q[name] = derive(q);
    corrected.forEach((volts, clutch) => (q[`base_${clutch + 1}`] = volts));
    const present = inputs.map(({ name, center, scale }) => limited((q[name] - center) / scale, -LIMIT, LIMIT));
    const first = this.seen.length === 0;
    const longest = history.at(-1) ?? 0;
    this.seen = first ? new Array(longest + 1).fill(present) : [present, ...this.seen.slice(0, longest)];
    this.means = averages.map((steps, k) =>
      first ? present : this.means[k].map((mean, i) => mean + (1 / steps) * (present[i] - mean)),
    );
    return [present, ...history.map((age) => this.seen[age]), ...this.means].flat();
  }

  /** Return what the layers make of the inputs. */
  outputs(inputs) {
    return this.layers.reduce((values, [weight, bias], layer) => {
      const bends = layer < this.layers.length - 1 || this.card.squashed;
      return Array.from(bias, (offset, row) => {
        let sum = 0;
        for (let k = 0, at = row * values.length; k < values.length; k++, at++) sum += values[k] * weight[at];
        return bends ? Math.tanh(sum + offset) : sum + offset;
      });
    }, inputs);
  }

  /** Return the voltage [V] of an output within ±1. */
  volts(output, corrected) {
    const { normalised, reach, voltage_max: top } = this.card;
    if (!normalised) return limited(corrected + reach * output, 0, top);
    const linear = (output + 1) * (top / 2);
    return linear * (linear / top);
  }
}
