// A path from a stroke that a person has drawn: even points of it, smoothed, and a chain of arcs through them.

import { placed } from "./world.js";

const FINE = 0.01;
const SPACING = 4; // points of a stroke are FINE apart, those of the path SPACING times as far
const SMOOTHED = 4; // each is the mean of so many before and behind it
const MIN_LENGTH = 0.2;
const NARROWEST = 0.03;
const SAMPLES = 257;

const distance = (a, b) => Math.hypot(b[0] - a[0], b[1] - a[1]);

/**
 * Return the path { arcs, length, error_max } of a stroke, [x, y] of its points [m].
 *
 * Returns a sentence instead where the stroke is too short, bends too sharply, or leaves the arm's reach.
 */
export function pathThrough(tables, kernels, stroke, arm) {
  const fine = evenly(stroke.filter((point, k) => k === 0 || distance(stroke[k - 1], point) > 0));
  if (FINE * fine.length < MIN_LENGTH) return `the path must be at least ${MIN_LENGTH} m long`;
  const points = smoothed(fine).filter((_, k, all) => k % SPACING === 0 && k <= all.length - 1 - SPACING / 2);
  points.push(fine.at(-1));
  const { arc: width, arcs: most } = tables.widths;
  const [given, table, point] = placed(kernels, [
    [Float64Array, points.flat()],
    [Float64Array, width * most * points.length],
    [Float64Array, 2],
  ]);
  const count = kernels.join(given.byteOffset, points.length, table.byteOffset);
  const arcs = Array.from({ length: count }, (_, k) => [...table.subarray(k * width, (k + 1) * width)]);
  const places = tables.places.arc;
  const length = arcs.at(-1)[places.start] + arcs.at(-1)[places.length];
  const bend = Math.max(...arcs.map((arc) => Math.abs(arc[places.curvature])));
  const error_max = Math.min(tables.error_max, tables.sharpest / bend);
  if (!(error_max >= NARROWEST)) return "the path must not bend so sharply";
  const reached = Array.from({ length: SAMPLES }, (_, k) => {
    kernels.locate(table.byteOffset, 0, count, (length * k) / (SAMPLES - 1), point.byteOffset);
    return inReach(tables, arm, ...point);
  });
  return reached.every(Boolean) ? { arcs, length, error_max } : "the path must stay within the arm's reach";
}

/** Return points of a stroke that are FINE apart. */
function evenly(stroke) {
  const points = stroke.slice(0, 1);
  let left = FINE;
  for (let k = 1; k < stroke.length; k++) {
    const [from, to] = [stroke[k - 1], stroke[k]];
    const step = distance(from, to);
    for (; left <= step; left += FINE) points.push(from.map((x, axis) => x + (left / step) * (to[axis] - x)));
    left -= step;
  }
  return points;
}

/** Return means of points with their neighbours, as many before as behind; so both ends stay. */
function smoothed(points) {
  return points.map((_, k) => {
    const reach = Math.min(SMOOTHED, k, points.length - 1 - k);
    const near = points.slice(k - reach, k + reach + 1);
    return [0, 1].map((axis) => near.reduce((sum, point) => sum + point[axis], 0) / near.length);
  });
}

/** Tell whether the arm reaches a point, and is not near a singular pose there. */
function inReach(tables, arm, x, y) {
  const { length_a: a, length_b: b } = arm;
  const cos = (x * x + y * y - a * a - b * b) / (2 * a * b);
  return Math.abs(cos) < 1 && Math.sqrt(1 - cos * cos) > tables.task.singularity_margin;
}
