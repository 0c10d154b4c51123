// Mouse, touch and keys.

const CLICK_PX = 4; // a drag that is shorter is a click
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const ARROW_PX = { turn: 15, pan: 30, cross: 10, fine: 1 }; // what one arrow key does, CSS pixels
const ZOOM = 1.2; // of one key
const WHEEL = 0.0015; // logarithm of the zoom per CSS pixel of the wheel

export class Input {
  constructor(viewer) {
    const { ui, root } = viewer;
    Object.assign(this, { viewer, ui, root, pointers: new Map(), drag: null });
    root.addEventListener("keydown", (event) => this.key(event));
    ui.panel.addEventListener("submit", (event) => event.preventDefault());
    const stage = ui.picture;
    stage.addEventListener("dblclick", () => viewer.fitView());
    stage.addEventListener("contextmenu", (event) => event.preventDefault());
    stage.addEventListener("pointerdown", (event) => this.press(event));
    stage.addEventListener("pointermove", (event) => this.moved(event));
    for (const name of ["pointerup", "pointercancel"]) {
      stage.addEventListener(name, (event) => this.release(event));
    }
    stage.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  /** Whether the view is held, so that it will move again. */
  get holds() {
    return Boolean(this.drag?.far && !this.drag.frames);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { viewer, ui, root } = this;
    const own = event.target === ui.picture;
    const control = root.querySelector(`[data-key="${CSS.escape(event.key.toLowerCase())}"]`);
    if (own && ARROWS[event.key]) this.arrow(ARROWS[event.key], event.shiftKey);
    else if (own && "+=".includes(event.key)) viewer.zoom(ZOOM);
    else if (own && "-_".includes(event.key)) viewer.zoom(1 / ZOOM);
    else if (own && event.key === "Enter" && viewer.cross) viewer.tools.pick(...viewer.cross);
    else if (event.key === "Escape" && viewer.cross) viewer.toggleCross();
    // Lists use letters to find their entries.
    else if (control && event.target.tagName !== "SELECT") control.click();
    else return;
    event.preventDefault();
  }

  arrow([x, y], shift) {
    const { viewer } = this;
    if (viewer.cross) viewer.moveCross(x, y, shift ? ARROW_PX.fine : ARROW_PX.cross);
    else if (shift) viewer.view.pan(-ARROW_PX.pan * x, -ARROW_PX.pan * y);
    else viewer.view.turnBy(ARROW_PX.turn * x, ARROW_PX.turn * y);
    if (!viewer.cross) viewer.move();
  }

  wheel(event) {
    // A viewer in a longer page must not catch the wheel of somebody who scrolls past it.
    if (!this.root.contains(document.activeElement)) return;
    event.preventDefault();
    const { viewer } = this;
    const factor = Math.exp(-WHEEL * event.deltaY);
    viewer.zoom(factor, event.offsetX % viewer.view.width, event.offsetY);
  }

  press(event) {
    const from = [event.offsetX, event.offsetY];
    this.ui.picture.focus();
    this.ui.picture.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, from);
    const pans = event.button === 2 || event.button === 1 || event.shiftKey;
    const frames = this.viewer.tools.name === "region" && !pans;
    this.drag = { from, pans, frames, far: this.pointers.size > 1 };
  }

  moved(event) {
    const { viewer, drag } = this;
    const at = [event.offsetX, event.offsetY];
    const last = this.pointers.get(event.pointerId);
    if (!last) {
      if (!viewer.cross) viewer.tools.inspect(...at);
      return;
    }
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, at);
    const [dx, dy] = [at[0] - last[0], at[1] - last[1]];
    drag.far ||= Math.hypot(at[0] - drag.from[0], at[1] - drag.from[1]) > CLICK_PX;
    if (!drag.far) return;
    if (other) this.pinch(at, last, other);
    else if (drag.frames) viewer.drawOver([...drag.from, ...at]);
    else if (drag.pans) viewer.view.pan(dx, dy);
    else viewer.view.turnBy(dx, dy);
    if (other || !drag.frames) viewer.move();
  }

  /** Two fingers: one has moved from `last` to `at`. */
  pinch(at, last, other) {
    const { view } = this.viewer;
    const size = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    view.pan((at[0] - last[0]) / 2, (at[1] - last[1]) / 2);
    view.zoom(size(at) / size(last), (at[0] + other[0]) / 2, (at[1] + other[1]) / 2);
  }

  release(event) {
    const { viewer, drag } = this;
    this.pointers.delete(event.pointerId);
    if (this.pointers.size || !drag) return;
    this.drag = null;
    const at = [event.offsetX, event.offsetY];
    if (event.type === "pointercancel") viewer.move();
    else if (!drag.far) viewer.tools.pick(...at);
    else if (drag.frames) viewer.tools.region([...drag.from, ...at]);
    else viewer.move();
    viewer.drawOver();
  }
}
