// The picture of a trial: arm, path, trail, hand and the clutches of the drive, on a canvas.

const WORLD = { left: -0.88, right: 0.76, low: -0.35, high: 1.04 };
const BESIDE = 0.05; // of the path [m]
const DISC = { radius: 0.075, y: -0.175, spacing: 0.23 };
const FULL_ARROW = 0.28; // of a force of ARROW_FORCE [m]
const ARROW_FORCE = 60;
const TITLES = ["A", "B", "A − B", "A + B"];
const TURN = 2 * Math.PI;

/** Return the colours of the style sheet by their names there. */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const names = "paper stage ink muted line lane link-a link-b trail force difference sum groove";
  return Object.fromEntries(
    names.split(" ").map((name) => [name, style.getPropertyValue(`--${name}`).trim()]),
  );
}

/** Match a canvas to its pixels on the screen; return context and size [CSS px]. */
export function fitted(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height };
}

/** Draws trials on one canvas. */
export class Scene {
  constructor(canvas) {
    this.canvas = canvas;
  }

  /** Return the point in the world [m] of a pointer event. */
  world(event) {
    const box = this.canvas.getBoundingClientRect();
    const { scale, x, y } = this.view(box.width, box.height);
    return {
      x: (event.clientX - box.left - x) / scale,
      y: (y - (event.clientY - box.top)) / scale,
    };
  }

  /** Return the point of the window [CSS px] where a point of the world [m] is seen. */
  screen({ x, y }) {
    const box = this.canvas.getBoundingClientRect();
    const view = this.view(box.width, box.height);
    return { x: box.left + view.x + view.scale * x, y: box.top + view.y - view.scale * y };
  }

  view(width, height) {
    const scale = Math.min(width / (WORLD.right - WORLD.left), height / (WORLD.high - WORLD.low));
    return {
      scale,
      x: width / 2 - (scale * (WORLD.left + WORLD.right)) / 2,
      y: height / 2 + (scale * (WORLD.low + WORLD.high)) / 2,
    };
  }

  /**
   * Draw a trial.
   *
   * part     how far the picture is between the last two control steps, 0 to 1
   * pointer  { x, y } [m] of the hand or null
   * ready    whether the trial waits for its hand
   */
  draw(trial, { part, pointer, ready, palette }) {
    const { context, width, height } = fitted(this.canvas);
    const view = this.view(width, height);
    Object.assign(this, { c: context, palette, px: 1 / view.scale });
    context.clearRect(0, 0, width, height);
    context.save();
    context.translate(view.x, view.y);
    context.scale(view.scale, -view.scale);
    context.lineCap = context.lineJoin = "round";
    this.path(trial);
    this.trail(trial);
    this.pacer(trial, part);
    const pose = this.pose(trial, part);
    this.drive(trial);
    this.arm(pose);
    this.handle(trial, pose.tip, pointer, ready);
    context.restore();
  }

  /** Return the pivots between the last two control steps. */
  pose(trial, part) {
    const last = trial.rows.length - 1;
    const before = Math.max(last - 1, 0);
    const angle = (name) =>
      trial.at(name, before) + part * (trial.at(name, last) - trial.at(name, before));
    const [a, b] = [angle("theta_a"), angle("theta_b")];
    const { length_a, length_b } = trial.env.context.machine.arm;
    const elbowA = [length_a * Math.cos(a), length_a * Math.sin(a)];
    const elbowB = [length_b * Math.cos(b), length_b * Math.sin(b)];
    return { elbowA, elbowB, tip: [elbowA[0] + elbowB[0], elbowA[1] + elbowB[1]] };
  }

  polyline(points, colour, pixels, dash = []) {
    const { c, px } = this;
    c.beginPath();
    for (const [x, y] of points) c.lineTo(x, y);
    c.strokeStyle = colour;
    c.lineWidth = pixels * px;
    c.setLineDash(dash.map((length) => length * px));
    c.stroke();
    c.setLineDash([]);
  }

  disc([x, y], radius, fill, edge = null, pixels = 2) {
    const { c, px } = this;
    c.beginPath();
    c.arc(x, y, radius, 0, TURN);
    c.fillStyle = fill;
    c.fill();
    if (!edge) return;
    c.strokeStyle = edge;
    c.lineWidth = pixels * px;
    c.stroke();
  }

  /** The path with its lane, a ring where it starts and a flag where it ends. */
  path(trial) {
    const { palette } = this;
    const { line } = trial;
    this.polyline(line, palette.lane, (2 * trial.env.context.task.error_max) / this.px);
    this.polyline(line, palette.line, 2.5);
    this.disc(line[0], 5 * this.px, palette.stage, palette.line, 2);
    this.disc(line.at(-1), 6 * this.px, palette.line);
    this.disc(line.at(-1), 2.5 * this.px, palette.stage);
  }

  /** A dot beside the path that moves at the commanded pace. */
  pacer(trial, part) {
    const rest = trial.rows.length > 1 ? (1 - part) * trial.period : 0;
    const { at, along } = trial.paced(trial.now.time - rest);
    const place = [at[0] - BESIDE * along[1], at[1] + BESIDE * along[0]];
    this.disc(place, 5 * this.px, this.palette.ink);
  }

  trail(trial) {
    const every = Math.max(1, Math.floor(trial.rows.length / 600));
    const [x, y] = [trial.columns.tip_x, trial.columns.tip_y];
    const points = trial.rows.filter((_, k) => k % every === 0).map((row) => [row[x], row[y]]);
    points.push([trial.now.tip_x, trial.now.tip_y]);
    this.polyline(points, this.palette.trail, 3);
  }

  arm({ elbowA, elbowB, tip }) {
    const { palette } = this;
    const hub = [0, 0];
    const width = Math.max(5, 0.022 / this.px);
    this.c.globalAlpha = 0.45;
    this.polyline([elbowA, tip], palette["link-b"], width * 0.7);
    this.polyline([elbowB, tip], palette["link-a"], width * 0.7);
    this.c.globalAlpha = 1;
    this.polyline([hub, elbowA], palette["link-a"], width);
    this.polyline([hub, elbowB], palette["link-b"], width);
    for (const pivot of [elbowA, elbowB]) this.disc(pivot, 0.35 * width * this.px, palette.stage);
    this.disc(hub, 0.05, palette.ink);
    this.disc(hub, 0.018, palette.stage);
  }

  /** The hand: its arrow of force, the spring to the pointer, the handle itself. */
  handle(trial, tip, pointer, ready) {
    const { palette, px } = this;
    const { force_x, force_y } = trial.now;
    const size = Math.hypot(force_x, force_y);
    if (pointer) {
      this.polyline([tip, [pointer.x, pointer.y]], palette.muted, 1.5, [3, 5]);
      this.disc([pointer.x, pointer.y], 6 * px, "transparent", palette.muted, 1.5);
    }
    if (size > 0.5)
      this.arrow(tip, (FULL_ARROW * size) / ARROW_FORCE, Math.atan2(force_y, force_x));
    if (ready) this.disc(tip, 22 * px, "transparent", palette.force, 1.5);
    this.disc(tip, 13 * px, palette.stage, palette.ink, 3);
    this.disc(tip, 5 * px, palette.force);
  }

  arrow([x, y], length, angle) {
    const { c, px } = this;
    const head = Math.min(14 * px, length);
    c.save();
    c.translate(x, y);
    c.rotate(angle);
    c.beginPath();
    c.rect(0, -2.5 * px, length - head, 5 * px);
    c.moveTo(length - head, 8 * px);
    c.lineTo(length, 0);
    c.lineTo(length - head, -8 * px);
    c.fillStyle = this.palette.force;
    c.fill();
    c.restore();
  }

  /** Clutches glow with their torque, fill with their voltage, and close when they lock. */
  drive(trial) {
    const { clutches } = trial.env.tables;
    const centres = clutches.map((_, k) => [
      (k - (clutches.length - 1) / 2) * DISC.spacing,
      DISC.y,
    ]);
    for (const centre of centres) this.polyline([[0, 0], centre], this.palette.groove, 3);
    centres.forEach((centre, k) => this.clutch(trial, k, centre));
  }

  clutch(trial, k, [x, y]) {
    const { c, palette, px } = this;
    const colour = palette[trial.env.tables.clutches[k].colour];
    const { radius } = DISC;
    const most = trial.env.tables.torque_max[trial.settings.machine];
    const glow = Math.sqrt(Math.min(1, Math.abs(trial.now[`torque_${k + 1}`]) / most));
    if (glow > 0.02) {
      const halo = c.createRadialGradient(x, y, radius, x, y, radius * 1.9);
      halo.addColorStop(0, colour);
      halo.addColorStop(1, "transparent");
      c.globalAlpha = 0.85 * glow;
      this.disc([x, y], radius * 1.9, halo);
      c.globalAlpha = 1;
    }
    const stuck = trial.clutch(k) === "stuck";
    this.disc([x, y], radius, stuck ? colour : palette.stage, palette.groove, 3);
    const volts = trial.now[`volts_${k + 1}`] / trial.env.machine.voltage_max;
    if (volts > 0) {
      c.beginPath();
      c.arc(x, y, radius, Math.PI / 2, Math.PI / 2 - TURN * volts, true);
      c.strokeStyle = stuck ? palette.ink : colour;
      c.lineWidth = 4 * px;
      c.stroke();
    }
    const ink = stuck ? palette.paper : palette.ink;
    if (stuck) this.lock([x, y + 0.03], ink);
    this.text(String(k + 1), x, y - (stuck ? 0.035 : 0), stuck ? 0.045 : 0.065, ink, 600);
    this.text(TITLES[k], x, y - radius - 0.042, 0.042, palette.muted, 400);
  }

  lock([x, y], colour) {
    const { c } = this;
    c.beginPath();
    c.arc(x, y + 0.002, 0.013, 0, Math.PI);
    c.strokeStyle = colour;
    c.lineWidth = 0.008;
    c.stroke();
    c.fillStyle = colour;
    c.fillRect(x - 0.02, y - 0.026, 0.04, 0.028);
  }

  text(words, x, y, size, colour, weight) {
    const { c, px } = this;
    const height = Math.max(size / px, 10);
    c.save();
    c.translate(x, y);
    c.scale(px, -px);
    c.font = `${weight} ${height}px system-ui, sans-serif`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.fillStyle = colour;
    c.fillText(words, 0, 0);
    c.restore();
  }
}
