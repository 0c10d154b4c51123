// Mouse, touch and keys.

const CLICK_PX = 4; // a drag that is shorter is a click
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const ARROW_PX = { turn: 15, pan: 30, cross: 10, fine: 1 }; // what one arrow key does, CSS pixels
const ZOOM = { "+": 1.2, "=": 1.2, "-": 1 / 1.2, _: 1 / 1.2 }; // of one key
const WHEEL = 0.0015; // logarithm of the zoom per CSS pixel of the wheel
const EVENTS = ["pointerdown", "pointermove", "pointerup", "pointercancel", "wheel"];

export class Input {
  constructor(viewer) {
    const { ui, root } = viewer;
    Object.assign(this, { viewer, ui, root, pointers: new Map(), drag: null });
    ui.picture.addEventListener("contextmenu", (event) => event.preventDefault());
    root.addEventListener("keydown", this);
    for (const name of EVENTS) ui.picture.addEventListener(name, this, { passive: false });
  }

  /** The methods of the events' names take them. */
  handleEvent(event) {
    const name = event.type === "pointercancel" ? "pointerup" : event.type;
    this[name](event, [event.offsetX, event.offsetY]);
  }

  /** Whether the view is held, so that it will move again. */
  get holds() {
    return Boolean(this.drag?.far && !this.drag.frames);
  }

  keydown(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { viewer, root } = this;
    const { key } = event;
    const own = event.target === this.ui.picture;
    const control = root.querySelector(`[data-key="${CSS.escape(key.toLowerCase())}"]`);
    if (own && ARROWS[key]) this.arrow(ARROWS[key], event.shiftKey);
    else if (own && ZOOM[key]) viewer.zoom(ZOOM[key]);
    else if (own && key === "Enter" && viewer.cross) viewer.tools.pick(...viewer.cross);
    else if (key === "Escape" && viewer.cross) viewer.toggleCross();
    // Lists use letters to find their entries.
    else if (control && event.target.tagName !== "SELECT") control.click();
    else return;
    event.preventDefault();
  }

  arrow([x, y], shift) {
    const { viewer } = this;
    if (viewer.cross) return viewer.moveCross(x, y, shift ? ARROW_PX.fine : ARROW_PX.cross);
    if (shift) viewer.view.pan(-ARROW_PX.pan * x, -ARROW_PX.pan * y);
    else viewer.view.turnBy(ARROW_PX.turn * x, ARROW_PX.turn * y);
    return viewer.move();
  }

  wheel(event, [x, y]) {
    // A viewer in a longer page must not catch the wheel of somebody who scrolls past it.
    if (!this.root.contains(document.activeElement)) return;
    event.preventDefault();
    this.viewer.zoom(Math.exp(-WHEEL * event.deltaY), x % this.viewer.view.width, y);
  }

  pointerdown(event, from) {
    this.ui.picture.focus();
    this.ui.picture.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, from);
    const pans = event.button === 2 || event.button === 1 || event.shiftKey;
    const frames = this.viewer.tools.name === "region" && !pans;
    this.drag = { from, pans, frames, far: this.pointers.size > 1 };
  }

  pointermove(event, at) {
    const { viewer, drag } = this;
    const last = this.pointers.get(event.pointerId);
    if (!last && !viewer.cross) viewer.tools.inspect(...at);
    if (!last) return;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, at);
    const [dx, dy] = [at[0] - last[0], at[1] - last[1]];
    drag.far ||= Math.hypot(at[0] - drag.from[0], at[1] - drag.from[1]) > CLICK_PX;
    if (!drag.far) return;
    if (other) this.pinch(at, last, other);
    else if (drag.frames) return viewer.drawOver([...drag.from, ...at]);
    else if (drag.pans) viewer.view.pan(dx, dy);
    else viewer.view.turnBy(dx, dy);
    viewer.move();
  }

  /** Two fingers: one has moved from `last` to `at`. */
  pinch(at, last, other) {
    const { view } = this.viewer;
    const size = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    view.pan((at[0] - last[0]) / 2, (at[1] - last[1]) / 2);
    view.zoom(size(at) / size(last), (at[0] + other[0]) / 2, (at[1] + other[1]) / 2);
  }

  pointerup(event, at) {
    const { viewer, drag } = this;
    this.pointers.delete(event.pointerId);
    if (this.pointers.size || !drag) return;
    this.drag = null;
    if (event.type === "pointercancel") viewer.move();
    else if (!drag.far) viewer.tools.pick(...at);
    else if (drag.frames) viewer.tools.region([...drag.from, ...at]);
    else viewer.move();
    viewer.drawOver();
  }
}
