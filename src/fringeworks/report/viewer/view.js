// How the surface lies on the screen: turned about its target, without perspective, so that the
// scale bar holds everywhere.

const DENSITY = 2; // largest number of drawn pixels per CSS pixel
const TURN = 0.008; // rad per CSS pixel
const FILLED = 0.88; // share of the panel that a fitted surface takes
const UPRIGHT = Math.PI / 2; // largest pitch: above it, the surface would stand on its head

export class View {
  /** `flipped`: y down and z away, as in a camera's coordinates; `side`: of a pixel. */
  constructor(flipped, box, stretch, side) {
    this.side = side;
    this.base = flipped ? [1, -1, -1] : [1, 1, 1];
    this.half = box.half.map((v, k) => v * (k === 2 ? stretch : 1));
    this.yaw = this.pitch = 0;
    this.scale = this.width = this.height = 1;
    this.target = [0, 0, 0];
  }

  resize(width, height) {
    const before = Math.min(this.width, this.height);
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
    this.density = Math.min(globalThis.devicePixelRatio || 1, DENSITY);
    this.scale *= Math.min(this.width, this.height) / before;
  }

  /** Distance of neighbouring points on the screen, CSS pixels. */
  get spacing() {
    return this.side * this.scale;
  }

  turnTo(yaw, pitch) {
    this.yaw = (yaw * Math.PI) / 180;
    this.pitch = (pitch * Math.PI) / 180;
  }

  turnBy(dx, dy) {
    this.yaw += TURN * dx;
    this.pitch = Math.min(Math.max(this.pitch + TURN * dy, -UPRIGHT), UPRIGHT);
  }

  /** Rows: right, up and towards the viewer in the surface's coordinates. */
  get turn() {
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const [d, t] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    const rows = [[c, 0, s], [s * t, d, -c * t], [-s * d, t, c * d]];
    return rows.map((row) => row.map((v, k) => v * this.base[k]));
  }

  /** Turned offset from the target to the screen: twelve numbers for column, row and nearness. */
  get toScreen() {
    const [right, up, near] = this.turn;
    const at = (row) => row.reduce((sum, v, k) => sum - v * this.target[k], 0);
    const { scale } = this;
    return [
      ...right.map((v) => v * scale), this.width / 2 + scale * at(right),
      ...up.map((v) => -v * scale), this.height / 2 - scale * at(up),
      ...near, at(near),
    ];
  }

  project([x, y, z]) {
    const m = this.toScreen;
    return [m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7]];
  }

  /** The same for WebGL, columns first. */
  get clip() {
    const m = this.toScreen;
    const reach = 8 * Math.hypot(...this.half) + Math.hypot(...this.target);
    const factors = [2 / this.width, -2 / this.height, -1 / reach];
    const [x, y, z] = factors.map((f, r) => m.slice(4 * r, 4 * r + 4).map((v) => f * v));
    const columns = [0, 1, 2].flatMap((k) => [x[k], y[k], z[k], 0]);
    return [...columns, x[3] - 1, y[3] + 1, z[3], 1];
  }

  pan(dx, dy) {
    const [right, up] = this.turn;
    this.target = this.target.map((v, k) => v - (right[k] * dx - up[k] * dy) / this.scale);
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
    const reach = (row) => row.reduce((sum, v, k) => sum + Math.abs(v) * this.half[k], 0);
    const [across, tall] = this.turn.map(reach);
    this.scale = (FILLED / 2) * Math.min(this.width / across, this.height / tall);
    this.target = [0, 0, 0];
  }
}
