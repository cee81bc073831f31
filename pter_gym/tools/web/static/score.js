// The package's score of an episode along its path, as pter_gym/benchmark/measures.py has it.

/**
 * Score an episode.
 *
 * rows   { time, arc_length, normal_error, is_success } of the reset and of each control step
 * task   { length, error_max, pace } of the path [m, m, m/s]
 * rules  `tables.scoring`
 *
 * Returns path_error_m, mean_pace_m_s and completed, as the package calls them.
 */
export function score(rows, task, rules) {
  const { segments, price } = rules;
  const errors = rows.map((row) => Math.abs(row.normal_error));
  const furthest = runningMaximum([0, ...rows.map((row) => row.arc_length)]);
  const clock = [rows[0].time, ...rows.map((row) => row.time)];
  const end = clock.at(-1);
  const needed = task.length / segments / task.pace;
  const marks = Array.from({ length: segments + 1 }, (_, k) =>
    passing(furthest, (task.length * k) / segments),
  );

  const lost = lostAtStart(furthest, clock, task, rules);
  const passed = marks.map((mark, k) => (mark ? at(mark, clock) : end) - (k > 0 ? lost : 0));
  const ratios = differences(passed).map((spent) => spent / needed);
  const finished = marks.slice(1).map(Boolean);

  const inTime = integral(differences(clock).map((step, k) => step * errors[k]));
  const onWay = wayIntegral(furthest, errors);
  const worst = Math.max(...errors, task.error_max);
  const segmentErrors = ratios.map((ratio, k) => {
    if (!finished[k]) return worst * paceFactor(Math.max(ratio, 1), price);
    const [from, to] = [marks[k], marks[k + 1]];
    const spent = ratio * needed;
    const overTime = spent > 0 ? (at(to, inTime) - at(from, inTime)) / spent : 0;
    const overWay = ((at(to, onWay) - at(from, onWay)) * segments) / task.length;
    return Math.max(overTime, overWay) * paceFactor(ratio, price);
  });
  return {
    path_error_m: Math.min(mean(segmentErrors), worst),
    mean_pace_m_s: passed.at(-1) > 0 ? Math.min(furthest.at(-1), task.length) / passed.at(-1) : 0,
    completed: rows.slice(1).some((row) => row.is_success === 1),
  };
}

const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

const differences = (values) => values.slice(1).map((value, k) => value - values[k]);

const paceFactor = (ratio, price) => (ratio > 1 ? ratio ** price : 1 + price * (1 - ratio));

function runningMaximum(values) {
  let most = -Infinity;
  return values.map((value) => (most = Math.max(most, value)));
}

/** Return sums of the parts up to each row, from 0 on. */
function integral(parts) {
  let sum = 0;
  return [0, ...parts.map((part) => (sum += part))];
}

/** Return where a maximum passed a mark, { before, after, part } of two rows, or null. */
function passing(furthest, mark) {
  const after = furthest.findIndex((way) => way >= mark);
  if (after < 0) return null;
  const before = Math.max(after - 1, 0);
  const step = furthest[after] - furthest[before];
  return { before, after, part: step > 0 ? (mark - furthest[before]) / step : 1 };
}

const at = ({ before, after, part }, values) =>
  values[before] + part * (values[after] - values[before]);

/** Return ∫|e|ds up to each row [m²]; new way counts with the largest error since the last. */
function wayIntegral(furthest, errors) {
  let worst = 0;
  const parts = differences(furthest).map((increment, k) => {
    worst = Math.max(worst, errors[k]);
    const part = worst * increment;
    if (increment > 0) worst = 0;
    return part;
  });
  return integral(parts);
}

/** Return the late start that does not count [s], within the allowance. */
function lostAtStart(furthest, clock, { length, pace }, { start, allowance }) {
  const begun = passing(furthest, length * start);
  const late = (begun ? at(begun, clock) : clock.at(-1)) - (length * start) / pace;
  return Math.min(Math.max(late, 0), allowance);
}
