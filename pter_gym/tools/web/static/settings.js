// The settings of the page: what they may be, and how an address holds them.

export const LAG = { low: 10, high: 300, unit: "ms" };
export const FRICTION = { low: 0.2, high: 2, unit: "times" };
const VOLTS = { low: 0, high: 24 };
const SCORE = { low: 0, high: 1000 };

export const CONTROLS = {
  Nobody: { free: "Free", locked: "Locked" },
  You: { sliders: "Your sliders" },
  "Control laws": {
    impedance: "Impedance",
    "torque-feedback": "Torque feedback",
    "single-dof": "Single DOF",
    "velocity-ratio": "Velocity ratio",
  },
  "Tuned laws": {
    "impedance-tuned": "Impedance, tuned",
    "torque-feedback-tuned": "Torque feedback, tuned",
    "single-dof-tuned": "Single DOF, tuned",
    "velocity-ratio-tuned": "Velocity ratio, tuned",
  },
  "Learned policies": { "ppo-standard": "PPO, for the line", residual: "Residual, for all paths" },
};

export const NAMES = Object.assign({}, ...Object.values(CONTROLS));

export const PATHS = { line: "Line", arc: "Arc", circle: "Circle", sine: "Sine", drawn: "Drawn by hand" };

export const PACES = {};

export const MATERIALS = {
  baseline: "Baseline",
  delrin_experimental: "Delrin, as measured",
  delrin_theoretical: "Delrin, as published",
};

export const DEFAULTS = {
  control: "single-dof-tuned",
  other: "residual",
  path: "line",
  stroke: null,
  hand: "you",
  pace: "medium",
  material: "baseline",
  lag: 105,
  friction: 1,
  volts: Object.freeze([0, 0, 0, 0]),
  beat: null,
};

/** Offer what the tables have, and begin with the machine, path and pace of a person's own if there are some. */
export function beginWith({ machines, laws, policies, paths, paces, begin, told: { own } }) {
  const there = { sliders: true, ...laws, ...policies };
  for (const names of [NAMES, ...Object.values(CONTROLS)]) keep(names, there);
  keep(MATERIALS, machines);
  if (paths.own) PATHS.own = "Your path";
  Object.assign(PACES, paces);
  Object.assign(DEFAULTS, begin);
  if (!there[DEFAULTS.other]) DEFAULTS.other = "impedance-tuned";
  if (!own) return;
  MATERIALS.own = "Your machine";
  const lag = Math.round(1000 * own.time_constant);
  Object.assign(DEFAULTS, { material: "own", lag: Math.min(LAG.high, Math.max(LAG.low, lag)) });
}

function keep(names, there) {
  for (const name of Object.keys(names)) if (!Object.hasOwn(there, name)) delete names[name];
}

const HANDS = { you: "You", paper: "The paper's push" };

const among = (names) => (text) => (Object.hasOwn(names, text) ? text : undefined);

const within = ({ low, high }) => (text) => {
  const value = text.trim() === "" ? NaN : Number(text);
  return value >= low && value <= high ? value : undefined;
};

function four(text) {
  const values = text.split(",").map(within(VOLTS));
  return values.length === 4 && values.every((value) => value !== undefined) ? values : undefined;
}

/** Points in whole millimetres: x,y;x,y;… */
function points(text) {
  const found = text.split(";").map((pair) => pair.split(",").map((part) => (/^-?\d{1,4}$/.test(part) ? part / 1000 : NaN)));
  const fits = found.length >= 2 && found.length <= 500 && found.every((pair) => pair.length === 2 && pair.every(Number.isFinite));
  return fits ? found : undefined;
}

const listed = (names) => `one of ${Object.keys(names).join(", ")}`;

/** Of each setting: how text becomes its value, and what is accepted. */
const KINDS = {
  control: [among(NAMES), listed(NAMES)],
  other: [among(NAMES), listed(NAMES)],
  path: [among(PATHS), listed(PATHS)],
  stroke: [points, "points x,y in whole millimetres, separated by ;"],
  hand: [among(HANDS), listed(HANDS)],
  pace: [among(PACES), "one of slow, medium, brisk"],
  material: [among(MATERIALS), listed(MATERIALS)],
  lag: [within(LAG), `a number of milliseconds from ${LAG.low} to ${LAG.high}`],
  friction: [within(FRICTION), `a number from ${FRICTION.low} to ${FRICTION.high}`],
  volts: [four, "four numbers from 0 to 24, separated by commas"],
  beat: [within(SCORE), "a score in millimetres from 0 to 1000"],
};

/**
 * Return { settings, problems } of the part of an address behind #.
 *
 * What it does not name has its default; what is wrong stays as it is at present, and is told in a sentence.
 */
export function parse(hash, present) {
  const settings = { ...DEFAULTS };
  const problems = [];
  for (const [name, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
    if (!Object.hasOwn(KINDS, name)) {
      problems.push(`The address has the setting “${shortened(name)}”, which this page does not know.`);
      continue;
    }
    const [read, accepted] = KINDS[name];
    const value = read(text);
    if (value === undefined) problems.push(`In the address, ${name} must be ${accepted}; it is “${shortened(text)}”.`);
    settings[name] = value ?? present[name];
  }
  if (settings.path === "drawn" && !settings.stroke) {
    problems.push("The address asks for a drawn path, but has no stroke of it.");
    settings.path = present.path;
  }
  return { settings, problems };
}

/** Return the part of an address behind # that holds what differs from the default settings. */
export function format(settings) {
  const parts = Object.keys(KINDS).filter((name) => {
    if (name === "stroke") return settings.path === "drawn";
    if (name === "volts") return settings.control === "sliders";
    return settings[name] !== DEFAULTS[name];
  });
  const text = (name) =>
    name === "stroke"
      ? settings.stroke.map((point) => point.map((x) => Math.round(1000 * x)).join(",")).join(";")
      : String(settings[name]);
  return parts.map((name) => `${name}=${text(name)}`).join("&");
}

const shortened = (text) => (text.length > 40 ? `${text.slice(0, 40)}…` : text);
