// Areas on the picture and on the surface alike: drawn, dragged by handles, moved by keys.

const CLICK_PX = 4; // a drag that is shorter is a click
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const FAR = 10; // pixels of an arrow key with Shift
const SVG = "http://www.w3.org/2000/svg";

const boxOf = ([x0, y0], [x1, y1]) => {
  const [left, right] = [x0, x1].map(Math.round).sort((a, b) => a - b);
  const [top, bottom] = [y0, y1].map(Math.round).sort((a, b) => a - b);
  return [[left, top], [right, top], [right, bottom], [left, bottom]];
};

class Editor {
  constructor(mount) {
    this.mount = mount;
    this.picture = Object.assign(new Image(), { draggable: false, alt: mount.dataset.alt });
    this.lines = document.createElementNS(SVG, "svg");
    this.lines.setAttribute("preserveAspectRatio", "none");
    this.lines.setAttribute("aria-hidden", "true");
    this.grips = document.createElement("div");
    mount.replaceChildren(this.picture, this.lines, this.grips);
    this.pen = [];
    this.list = [];
    for (const name of ["pointerdown", "pointermove", "pointerup", "dblclick", "keydown"]) {
      mount.addEventListener(name, (event) => this[name](event));
    }
  }

  /** The picture, and how many columns and rows of the frame one of its pixels stands for. */
  load(address, step, size) {
    Object.assign(this, { step, size });
    this.picture.src = address;
    this.lines.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
    this.draw();
  }

  place({ clientX, clientY }) {
    const { left, top, width, height } = this.picture.getBoundingClientRect();
    const within = (v, most) => Math.min(Math.max(v, 0), most - 1);
    const [columns, rows] = this.size;
    return [
      within(((clientX - left) / width) * columns - 0.5, columns),
      within(((clientY - top) / height) * rows - 0.5, rows),
    ];
  }

  pointerdown(event) {
    if (!this.size || event.button) return;
    const grip = event.target.closest(".fw-grip");
    this.mount.setPointerCapture(event.pointerId);
    this.from = [event.clientX, event.clientY];
    if (grip) this.held = { name: grip.dataset.name, corner: Number(grip.dataset.corner) };
    else if (this.shape === "box") this.pen = [this.place(event), this.place(event)];
    if (!grip) event.preventDefault();
  }

  pointermove(event) {
    if (this.held) this.move(this.held.name, this.held.corner, this.place(event));
    else if (this.shape === "box" && this.pen.length && event.buttons) {
      this.pen[1] = this.place(event);
      this.draw();
    }
  }

  pointerup(event) {
    if (!this.from) return;
    const far = Math.hypot(event.clientX - this.from[0], event.clientY - this.from[1]) > CLICK_PX;
    this.from = null;
    if (this.held) {
      if (far) this.tell(this.held.name);
      this.held = null;
    } else if (this.shape === "box") {
      const [one, other] = this.pen;
      this.pen = [];
      if (far && one) globalThis.emitEvent("fw-area", ["new", "box", boxOf(one, other)]);
      else this.draw();
    } else {
      this.pen.push(this.place(event));
      this.draw();
    }
  }

  dblclick() {
    if (this.shape === "polygon") this.close();
  }

  /** The polygon that is being drawn is an area from now on. */
  close() {
    // A double click is two clicks at one place.
    const same = ([x, y], other) => other && x === other[0] && y === other[1];
    const corners = this.pen.filter((at, k, all) => !same(at, all[k - 1]));
    this.pen = [];
    globalThis.emitEvent("fw-area", ["new", "polygon", corners]);
  }

  back() {
    this.pen.pop();
    this.draw();
  }

  keydown(event) {
    const grip = event.target.closest(".fw-grip");
    const way = ARROWS[event.key];
    if (!grip || !way) return;
    event.preventDefault();
    const { name } = grip.dataset;
    const corner = Number(grip.dataset.corner);
    const { corners } = this.list.find((one) => one.name === name);
    const at = corner < 0 ? middle(corners) : corners[corner];
    const far = event.shiftKey ? FAR : 1;
    this.move(name, corner, [at[0] + far * way[0], at[1] + far * way[1]]);
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.tell(name), 400); // one entry of Undo for many keys
  }

  /** Move a corner of an area, or with −1 all of it, as the hand does: nothing is written yet. */
  move(name, corner, [x, y]) {
    const area = this.list.find((one) => one.name === name);
    if (!area) return;
    const { corners } = area;
    if (corner < 0) {
      const [column, row] = middle(corners);
      area.corners = corners.map((one) => [one[0] + x - column, one[1] + y - row]);
    } else if (area.box) {
      // Corners go round: the opposite one stays, those beside share a column or a row with both.
      const [ox, oy] = corners[(corner + 2) % 4];
      const besides = [[x, oy], [ox, y]];
      if (corner % 2 === 0) besides.reverse();
      const moved = [[x, y], besides[0], [ox, oy], besides[1]];
      area.corners = corners.map((_, k) => moved[(k - corner + 4) % 4]);
    } else {
      area.corners = corners.with(corner, [x, y]);
    }
    this.draw();
  }

  tell(name) {
    const { box, corners } = this.list.find((one) => one.name === name);
    const [xs, ys] = [0, 1].map((k) => corners.map((corner) => corner[k]));
    const ends = [Math.min(...xs), Math.min(...ys)];
    const others = [Math.max(...xs), Math.max(...ys)];
    globalThis.emitEvent("fw-area", ["set", name, box ? boxOf(ends, others) : corners]);
  }

  /** Draw the areas here and on the surface. */
  draw() {
    if (!this.size) return;
    const to = ([x, y], k) => `${k ? "L" : "M"}${x + 0.5} ${y + 0.5}`;
    const path = (corners) => corners.map(to).join("");
    const pen = this.shape === "box" && this.pen.length ? boxOf(...this.pen) : this.pen;
    const paths = [...this.list.map(({ corners }) => `${path(corners)}Z`), path(pen)];
    this.lines.replaceChildren(
      ...paths.map((text) => {
        const line = document.createElementNS(SVG, "path");
        line.setAttribute("d", text);
        return line;
      }),
    );
    const wanted = this.list.flatMap(({ name, corners }) => [
      { name, corner: -1, at: middle(corners) },
      ...corners.map((at, corner) => ({ name, corner, at })),
    ]);
    while (this.grips.children.length > wanted.length) this.grips.lastChild.remove();
    for (const [k, { name, corner, at }] of wanted.entries()) {
      const grip = this.grips.children[k] ?? this.grips.appendChild(button());
      const place = at.map((v) => Math.round(v));
      grip.className = corner < 0 ? "fw-grip fw-all" : "fw-grip";
      Object.assign(grip.dataset, { name, corner });
      grip.textContent = corner < 0 ? name : "";
      const what = corner < 0 ? "all of it" : `corner ${corner + 1}`;
      grip.ariaLabel = `${name}, ${what}: column ${place[0]}, row ${place[1]}`;
      grip.style.left = `${(100 * (at[0] + 0.5)) / this.size[0]}%`;
      grip.style.top = `${(100 * (at[1] + 0.5)) / this.size[1]}%`;
    }
    surfaces(this);
  }
}

const middle = (corners) =>
  [0, 1].map((k) => corners.reduce((sum, corner) => sum + corner[k], 0) / corners.length);

const button = () => Object.assign(document.createElement("button"), { type: "button" });

/** Draw the areas on the surface that is shown; its handles move those of the picture. */
const surfaces = (editor) => {
  const { viewer } = document.getElementById(editor.surface) ?? {};
  if (!viewer?.tools || !editor.every) return;
  const tell = (name, corner, place, ended) => {
    if (place) editor.move(name, corner, place);
    if (ended) editor.tell(name);
  };
  viewer.areas ??= new viewer.constructor.Areas(viewer, editor.every, tell);
  viewer.areas.show(editor.list);
};

document.addEventListener("fw-surface", () => {
  for (const { editor } of document.querySelectorAll(".fw-picture")) editor?.draw();
});

const of = (id) => {
  const mount = document.getElementById(id);
  if (mount) mount.editor ??= new Editor(mount);
  return mount?.editor;
};

/** Show areas: `every` is how many columns and rows a pixel of the surface stands for. */
export const show = (id, list, shape, surface, every) => {
  const editor = of(id);
  if (!editor) return;
  if (editor.shape !== shape) editor.pen = [];
  Object.assign(editor, { list, shape, surface, every });
  editor.draw();
};

export const load = (id, ...picture) => of(id)?.load(...picture);
export const close = (id) => of(id)?.close();
export const back = (id) => of(id)?.back();

/** Make an area of the rectangle that was dragged over the surface with the tool Region. */
export const region = (id) => {
  const editor = of(id);
  const { viewer } = document.getElementById(editor?.surface) ?? {};
  const { surface, pixels } = viewer?.tools?.chosen ?? {};
  if (!pixels?.length) {
    globalThis.emitEvent("fw-area", ["none"]);
    return;
  }
  let [left, top, right, bottom] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const i of pixels) {
    const [column, row] = [i % surface.width, Math.floor(i / surface.width)];
    [left, right] = [Math.min(left, column), Math.max(right, column)];
    [top, bottom] = [Math.min(top, row), Math.max(bottom, row)];
  }
  const ends = [[left, top], [right, bottom]].map((at) => at.map((v) => v * editor.every));
  globalThis.emitEvent("fw-area", ["new", "box", boxOf(...ends)]);
};
