// Clip planes across x, y and z: six sliders over the box of the surface.

import { make } from "./numbers.js";

const FAR = 1e9; // a plane that clips nothing, beyond every surface
const STEPS = 1000; // of a slider
const REACH = 1.02; // of the sliders over half the box, so that they reach its outermost points

export class Clips {
  constructor(element, box, stretch) {
    this.centre = box.centre;
    this.stretch = [1, 1, stretch];
    this.reach = box.half.map((v) => REACH * v);
    const places = ["x", "y", "z"].flatMap((axis, k) => [[axis, k, "from"], [axis, k, "to"]]);
    this.planes = places.map(([axis, k, end]) => {
      const start = end === "to" ? STEPS : 0;
      const input = make("input", "", { type: "range", min: 0, max: STEPS, value: start });
      const [label, text] = [make("label", `${axis} ${end} `), make("span")];
      label.append(text, input);
      element.append(label);
      return { input, text, start, k, end };
    });
    this.tell();
  }

  /** Distance of a plane from the middle of the box; null for a slider at its start. */
  offset({ input, start, k }) {
    const at = Number(input.value);
    return at === start ? null : ((2 * at) / STEPS - 1) * this.reach[k];
  }

  /** The lowest or highest coordinates that are shown, as the screen counts them. */
  ends(end) {
    const planes = this.planes.filter((plane) => plane.end === end);
    const free = end === "to" ? FAR : -FAR;
    return planes.map((plane) => (this.offset(plane) ?? free) * this.stretch[plane.k]);
  }

  /** Say at which coordinates the planes lie. */
  tell() {
    for (const plane of this.planes) {
      const offset = this.offset(plane);
      const at = offset === null ? "–" : (this.centre[plane.k] + offset).toFixed(2);
      plane.text.textContent = at;
    }
  }
}
