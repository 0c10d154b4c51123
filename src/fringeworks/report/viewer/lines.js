// Lines on the surface: the profile that was picked, and outlines of areas with their handles.

import { between } from "./measure.js";
import { make } from "./numbers.js";

const MOST_SAMPLES = 160; // of an edge: more is slower, and no more is seen

/** Pixels from one to another, thinned to what a picture needs. */
function edge(surface, i, j) {
  const all = between(surface, i, j);
  const every = Math.ceil(all.length / MOST_SAMPLES);
  return all.filter((_, k) => k % every === 0 || k === all.length - 1);
}

/** Screen pixels to a tenth: a path of full doubles would be three times as long. */
const tenths = (px) => Math.round(10 * px) / 10;

/** A path over the surface's points, interrupted where none were measured. */
function pathOf(viewer, surface, pixels) {
  const { m11, m21, m31, m41, m12, m22, m32, m42 } = viewer.view.toScreen;
  const { shown, reason } = surface;
  let [text, pen] = ["", "M"];
  for (const i of pixels) {
    const [x, y, z] = [shown[3 * i], shown[3 * i + 1], shown[3 * i + 2]];
    const column = m11 * x + m21 * y + m31 * z + m41;
    const row = m12 * x + m22 * y + m32 * z + m42;
    if (reason[i] || Number.isNaN(column + row)) {
      pen = "M";
    } else {
      text += `${pen}${tenths(column)} ${tenths(row)}`;
      pen = "L";
    }
  }
  return text;
}

/** The pixel of a surface at a column and a row of the frame. */
function pixelAt({ width, height }, every, [x, y]) {
  const within = (v, most) => Math.min(Math.max(Math.round(v / every), 0), most - 1);
  return within(y, height) * width + within(x, width);
}

const middle = (corners) =>
  [0, 1].map((k) => corners.reduce((sum, corner) => sum + corner[k], 0) / corners.length);

/** Areas of the frame on the surface. `every` is how many columns and rows a pixel stands for;
 * `tell` is called with an area, what is dragged of it (−1: all of it), and where to. */
export class Areas {
  constructor(viewer, every, tell) {
    Object.assign(this, { viewer, every, tell, list: [], held: null });
    for (const over of viewer.ui.over.children) {
      over.addEventListener("pointerdown", (event) => this.hold(event));
      over.addEventListener("pointermove", (event) => this.drag(event));
      for (const name of ["pointerup", "pointercancel"]) {
        over.addEventListener(name, (event) => this.drop(event));
      }
    }
  }

  show(list) {
    this.list = list;
    this.viewer.drawOver();
  }

  hold(event) {
    const grip = event.target.closest(".grip");
    if (!grip) return;
    event.preventDefault();
    grip.setPointerCapture(event.pointerId);
    this.held = { area: this.list[grip.dataset.area], corner: Number(grip.dataset.corner) };
  }

  drag(event) {
    if (!this.held) return;
    const place = this.placeOf(event);
    if (place) this.tell(this.held.area.name, this.held.corner, place, false);
  }

  drop(event) {
    if (!this.held) return;
    this.drag(event);
    this.tell(this.held.area.name, this.held.corner, null, true);
    this.held = null;
  }

  /** Column and row of the frame below the pointer. */
  placeOf({ clientX, clientY }) {
    const { left, top } = this.viewer.ui.stage.getBoundingClientRect();
    const { surface, pixel } = this.viewer.tools.at(clientX - left, clientY - top);
    if (pixel < 0) return null;
    const { width } = surface;
    return [(pixel % width) * this.every, Math.floor(pixel / width) * this.every];
  }

  draw(surface, path, grips, put) {
    let [text, count] = ["", 0];
    for (const [n, { name, corners }] of this.list.entries()) {
      const pixels = corners.map((corner) => pixelAt(surface, this.every, corner));
      for (const [k, pixel] of pixels.entries()) {
        text += pathOf(this.viewer, surface, edge(surface, pixel, pixels[(k + 1) % pixels.length]));
      }
      const centre = pixelAt(surface, this.every, middle(corners));
      for (const [k, pixel] of [[-1, centre], ...pixels.entries()]) {
        const at = this.viewer.view.project(surface.shown.subarray(3 * pixel, 3 * pixel + 3));
        const grip = grips.children[count] ?? grips.appendChild(make("i"));
        grip.className = k < 0 ? "grip all" : "grip";
        Object.assign(grip.dataset, { area: n, corner: k });
        grip.hidden = Number.isNaN(at[0]);
        if (grip.textContent !== (k < 0 ? name : "")) {
          grip.replaceChildren(...(k < 0 ? [make("b", name)] : []));
        }
        if (!grip.hidden) put(grip, ...at);
        count++;
      }
    }
    while (grips.children.length > count) grips.lastChild.remove();
    path.setAttribute("d", text);
  }
}

/** The profile's line on the surface that it was picked on. */
export function drawProfile(viewer, path) {
  const { picks, owner } = viewer.tools;
  const there = picks.length === 2 && viewer.active.includes(owner) && owner.header.raster;
  path.setAttribute("d", there ? pathOf(viewer, owner, edge(owner, ...picks)) : "");
}
