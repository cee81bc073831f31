// A world and a law as arrays in the module's memory, by the names of the package's records.

/** Return an object that accesses an array by nested names with their `places`. */
export function named(places, numbers) {
  const record = {};
  for (const [name, place] of Object.entries(places)) {
    const property =
      typeof place === "number"
        ? { get: () => numbers[place], set: (value) => (numbers[place] = value) }
        : { value: named(place, numbers) };
    Object.defineProperty(record, name, { ...property, enumerable: true });
  }
  return record;
}

/** Return an object that reads the entries of an array by their names, in their units. */
export function inUnits(fields, values) {
  const record = {};
  fields.forEach(({ name, scale }, index) =>
    Object.defineProperty(record, name, { get: () => values[index] * scale, enumerable: true }),
  );
  return record;
}

/** Write the numbers of nested objects to an array. */
export function fill(places, values, numbers) {
  for (const [name, place] of Object.entries(places)) {
    if (typeof place === "number") numbers[place] = values[name];
    else fill(place, values[name], numbers);
  }
}

/** Return arrays in a module's memory, each of a type, with a length or a content. */
export function placed(kernels, parts) {
  let end = kernels.__heap_base.value;
  const offsets = parts.map(([type, content]) => {
    const begin = (end + 7) & ~7;
    end = begin + type.BYTES_PER_ELEMENT * (content.length ?? content);
    return begin;
  });
  const missing = end - kernels.memory.buffer.byteLength;
  if (missing > 0) kernels.memory.grow(Math.ceil(missing / 65536));
  return parts.map(([type, content], index) => {
    const array = new type(kernels.memory.buffer, offsets[index], content.length ?? content);
    if (content.length) array.set(content);
    return array;
  });
}

/**
 * One world by the arrays that the kernels work on.
 *
 * `config` and `constants` begin as the records `Config` and `Context` of the package lay them out;
 * behind them are the scales of the observation, and the tables of arcs and recordings. `entries`
 * is the number of an observation's entries, `draws` that of the contexts from which a reset draws.
 * `guides` says that the hand may have more than a push and sines.
 */
export class World {
  constructor(tables, kernels, { config, constants, entries, draws, guides }) {
    const { widths, places } = tables;
    [
      this.numbers,
      this.words,
      this.observation,
      this.telemetry,
      this.config,
      this.constants,
      this.volts,
      this.point,
    ] = placed(kernels, [
      [Float64Array, widths.world],
      [BigUint64Array, 2],
      [Float32Array, entries],
      [Float64Array, widths.telemetry],
      [Float64Array, config],
      [Float64Array, constants],
      [Float64Array, 4],
      [Float64Array, 2],
    ]);
    this.kernels = kernels;
    this.guides = guides ? 1 : 0;
    this.arguments = [
      this.numbers.byteOffset,
      this.words.byteOffset,
      this.observation.byteOffset,
      entries,
      this.telemetry.byteOffset,
      this.config.byteOffset,
      this.constants.byteOffset,
    ];
    this.state = named(places.world, this.numbers);
    this.state.draws = draws;
  }

  /** Start an episode of a seed, two whole numbers from 0 on as BigInts. */
  reset(seed, episode) {
    this.words[0] = seed;
    this.words[1] = episode;
    this.kernels.reset(...this.arguments);
  }

  /** Run a control step with `volts`; return whether it was refused, and nothing has moved. */
  step() {
    return this.kernels.step(...this.arguments, this.volts.byteOffset, this.guides) !== 0;
  }

  /** Return the point [x, y] at an arc length [m] of a path whose arcs are in the constants. */
  pointAt({ first, arcs }, arcLength) {
    this.kernels.locate(this.constants.byteOffset, first, arcs, arcLength, this.point.byteOffset);
    return [...this.point];
  }
}

/** A control law: `act(observation)` returns voltages; `reset()` begins an episode. */
export class Law {
  constructor(tables, kernels, gains, { memory, scales } = {}) {
    scales ??= tables.observation.map((field) => field.scale);
    [this.observation, this.scales, this.gains, this.memory, this.wanted] = placed(kernels, [
      [Float32Array, scales.length],
      [Float64Array, scales],
      [Float64Array, gains],
      [Float64Array, memory ?? tables.widths.memory],
      [Float64Array, 4],
    ]);
    this.kernels = kernels;
  }

  reset() {
    this.memory.fill(0);
  }

  /** Return the voltages [V] for an observation, float32. */
  act(observation) {
    this.observation.set(observation);
    this.kernels.act(
      this.observation.byteOffset,
      this.scales.length,
      this.scales.byteOffset,
      this.gains.byteOffset,
      this.gains.length,
      this.memory.byteOffset,
      this.memory.length,
      this.wanted.byteOffset,
    );
    return Float32Array.from(this.wanted);
  }
}
