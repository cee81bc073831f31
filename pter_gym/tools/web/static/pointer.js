// Where a person's hand is: led by a mouse, a finger or the arrow keys.

const SPEED = 0.3; // of the arrow keys [m/s]
const FAST = 2.5;
const LEASH = 0.22; // how far the arrow keys lead the handle [m]
const NEAR = 0.12; // pressing farther than this from the handle pulls it without a jump [m]

const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** Follows a canvas; `point` is { x, y } in the world [m] while the handle is held, else null. */
export class Pointer {
  #pressed = new Set();
  #offset = { x: 0, y: 0 };
  #fast = false;

  /**
   * scene   what turns pixels into metres
   * tip     tells where the handle is
   * told    { grab, key } are called when the handle is taken, and with keys that are not arrows
   */
  constructor(scene, tip, told) {
    Object.assign(this, { scene, tip, told, point: null, by: null });
    const { canvas } = scene;
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    for (const kind of ["pointerup", "pointercancel"])
      canvas.addEventListener(kind, () => this.by === "pointer" && this.release());
    canvas.addEventListener("keydown", (event) => this.#keyDown(event));
    canvas.addEventListener("keyup", (event) => this.#pressed.delete(event.key));
    canvas.addEventListener("blur", () => this.#pressed.clear());
  }

  /** Let the handle go. */
  release() {
    this.point = this.by = null;
    this.#pressed.clear();
    this.scene.canvas.classList.remove("held");
  }

  /** Move the hand that arrow keys lead, for one control period [s]. */
  advance(period) {
    if (this.by !== "keys" || this.#pressed.size === 0) return;
    const reach = SPEED * (this.#fast ? FAST : 1) * period;
    const ways = [...this.#pressed].map((key) => KEYS[key]);
    const tip = this.tip();
    let [dx, dy] = ["x", "y"].map(
      (axis, k) =>
        this.point[axis] - tip[axis] + reach * ways.reduce((sum, way) => sum + way[k], 0),
    );
    const part = Math.min(1, LEASH / Math.hypot(dx, dy));
    this.point = { x: tip.x + part * dx, y: tip.y + part * dy };
  }

  #down(event) {
    if (event.button !== 0) return;
    this.scene.canvas.setPointerCapture(event.pointerId);
    this.release();
    if (!this.told.grab()) return;
    const [at, tip] = [this.scene.world(event), this.tip()];
    const away = { x: tip.x - at.x, y: tip.y - at.y };
    this.#offset = Math.hypot(away.x, away.y) > NEAR ? away : { x: 0, y: 0 };
    this.by = "pointer";
    this.scene.canvas.classList.add("held");
    this.#move(event);
  }

  #move(event) {
    if (this.by !== "pointer") return;
    const { x, y } = this.scene.world(event);
    this.point = { x: x + this.#offset.x, y: y + this.#offset.y };
  }

  #keyDown(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    this.#fast = event.shiftKey;
    if (!Object.hasOwn(KEYS, event.key)) {
      if (event.key === " ") this.release();
      if (event.key === " " || this.told.key(event.key.toLowerCase())) event.preventDefault();
      return;
    }
    event.preventDefault();
    if (event.repeat && this.#pressed.has(event.key)) return;
    if (this.by !== "keys") {
      if (!this.told.grab()) return;
      this.by = "keys";
      this.point = { ...this.tip() };
    }
    this.#pressed.add(event.key);
  }
}
