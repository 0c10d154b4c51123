// How the surface lies on the screen: turned about its target, without perspective, so that the
// scale bar holds everywhere.

const DENSITY = 2; // largest number of drawn pixels per CSS pixel
const TURN = 0.46; // degrees per CSS pixel
const FILLED = 0.88; // share of the panel that a fitted surface takes
const UPRIGHT = 90; // largest pitch: above it, the surface would stand on its head

export class View {
  constructor({ side, away, box, stretch }) {
    const half = box.half.with(2, box.half[2] * stretch);
    Object.assign(this, { side, half, base: away ? -1 : 1, yaw: 0, pitch: 0 });
    Object.assign(this, { scale: 1, width: 1, height: 1, target: [0, 0, 0] });
  }

  resize(width, height) {
    const before = Math.min(this.width, this.height);
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
    this.density = Math.min(globalThis.devicePixelRatio, DENSITY);
    this.scale *= Math.min(this.width, this.height) / before;
  }

  /** Distance of neighbouring points on the screen, CSS pixels. */
  get spacing() {
    return this.side * this.scale;
  }

  turnBy(dx, dy) {
    this.yaw += TURN * dx;
    this.pitch = Math.min(Math.max(this.pitch + TURN * dy, -UPRIGHT), UPRIGHT);
  }

  /** From the surface to x right, y up, z towards the viewer. */
  get turn() {
    const tilted = new DOMMatrix().rotateAxisAngle(1, 0, 0, this.pitch);
    return tilted.rotateAxisAngle(0, 1, 0, this.yaw).scale(1, this.base, this.base);
  }

  /** From the surface to CSS pixels: column, row, nearness. */
  get toScreen() {
    const { width, height, scale, turn, target } = this;
    const middle = new DOMMatrix().translate(width / 2, height / 2).scale(scale, -scale, scale);
    return middle.multiply(turn).translate(...target.map((v) => -v));
  }

  project([x, y, z]) {
    const at = this.toScreen.transformPoint({ x, y, z });
    return [at.x, at.y];
  }

  /** From the surface to the box of WebGL. */
  get clip() {
    const { width, height, scale, half, target } = this;
    const reach = scale * (8 * Math.hypot(...half) + Math.hypot(...target));
    const box = new DOMMatrix().translate(-1, 1).scale(2 / width, -2 / height, -1 / reach);
    return box.multiply(this.toScreen).toFloat32Array();
  }

  pan(dx, dy) {
    const { x, y, z } = this.turn.inverse().transformPoint({ x: dx, y: -dy });
    this.target = this.target.map((v, k) => v - [x, y, z][k] / this.scale);
  }

  /** Zoom so that the place under the cursor stays. */
  zoom(factor, x, y) {
    const [dx, dy] = [x - this.width / 2, y - this.height / 2];
    this.pan(-dx, -dy);
    this.scale *= factor;
    this.pan(dx, dy);
  }

  /** Show the whole surface. */
  fit() {
    const { m11, m21, m31, m12, m22, m32 } = this.turn;
    const reach = (row) => row.reduce((sum, v, k) => sum + Math.abs(v) * this.half[k], 0);
    const [across, tall] = [[m11, m21, m31], [m12, m22, m32]].map(reach);
    this.scale = (FILLED / 2) * Math.min(this.width / across, this.height / tall);
    this.target = [0, 0, 0];
  }
}
