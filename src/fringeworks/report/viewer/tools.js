// What the viewer reads and measures at the cursor: values, distances with profiles, fitted bodies.

import { LAYERS } from "./assets.js";
import { fitRegion } from "./fit.js";
import { distance, pointAt, profile } from "./measure.js";
import { pick, pickMap } from "./mesh.js";
import { decimals, filled, make } from "./numbers.js";
import { drawChart } from "./overlay.js";

const REACH_PX = [6, 40]; // how far from a point the cursor may be; more between sparse points
const HINTS = {
  turn: "",
  distance: "Pick two points.",
  region: "Drag a rectangle, or pick two corners. All points in it count that are not clipped.",
};

export class Tools {
  constructor(viewer) {
    this.viewer = viewer;
    this.ui = viewer.ui;
    this.forget();
  }

  /** turn, distance or region. */
  get name() {
    return this.ui.panel.elements.tool.value;
  }

  changed() {
    this.ui.hint.textContent = HINTS[this.name];
    this.ui.bodyRow.hidden = this.name !== "region";
    this.forget();
    this.viewer.drawOver();
  }

  forget() {
    this.picks = [];
    this.corner = this.frame = this.chosen = null;
    this.ui.result.replaceChildren();
    this.ui.chart.hidden = true;
  }

  /** The surface of a panel and the pixel of it that is at a place of the stage, −1 for none. */
  at(x, y) {
    const { active, view } = this.viewer;
    const panel = Math.min(Math.floor(x / view.width), active.length - 1);
    this.map ??= active.map((surface) => pickMap(surface, view, this.viewer.shows(surface)));
    const reach = Math.min(Math.max(REACH_PX[0], Math.ceil(view.spacing)), REACH_PX[1]);
    const [column, row] = [Math.floor(x - panel * view.width), Math.floor(y)];
    return { surface: active[panel], pixel: pick(this.map[panel], column, row, reach) };
  }

  inspect(x, y) {
    const { surface, pixel } = this.at(x, y);
    this.viewer.say(pixel < 0 ? "Nothing here." : this.describe(surface, pixel));
  }

  /** A pixel in words: its point, σ and maps; or why it has no value and what to change. */
  describe({ header, width, reason, sigma, raster, layers, points }, i) {
    const { unit, lateral_unit: lateral } = header;
    const place = raster ? `column ${i % width}, row ${Math.floor(i / width)}` : `point ${i}`;
    if (reason[i]) {
      const { label, meaning, advice } = header.reasons[reason[i]];
      return `${place}: no value (${label}): ${meaning}. What to do: ${advice}.`;
    }
    const digits = decimals(sigma[i]);
    const [x, y, z] = pointAt({ points }, i).map((v) => v.toFixed(digits));
    const known = Number.isNaN(sigma[i]) ? "unknown" : `${sigma[i].toPrecision(2)} ${unit}`;
    const parts = [`${place}: x ${x}, y ${y} ${lateral}, z ${z} ${unit}, σ ${known}`];
    for (const { name, values, packed, unit: own } of layers) {
      const { told, label } = LAYERS[name];
      if (!told || packed || Number.isNaN(values[i])) continue;
      parts.push(`${label.toLowerCase()} ${values[i].toPrecision(4)} ${own}`);
    }
    return parts.join(", ");
  }

  /** A click, or Enter at the crosshair. */
  pick(x, y) {
    this.inspect(x, y);
    if (this.name === "distance") this.pickPoint(this.at(x, y));
    else if (this.name === "region" && this.corner) this.region([...this.corner, x, y]);
    else if (this.name === "region") this.corner = [x, y];
    this.viewer.drawOver();
  }

  pickPoint({ surface, pixel }) {
    if (pixel < 0 || surface.reason[pixel]) return;
    if (this.picks.length === 2 || this.owner !== surface) this.forget();
    this.owner = surface;
    this.picks.push(pixel);
    if (this.picks.length === 2 && this.picks[0] !== this.picks[1]) this.tellDistance(surface);
  }

  tellDistance(surface) {
    const [i, j] = this.picks;
    const { metric, unit, lateral_unit: lateral } = surface.header;
    const { length, offset, sigma } = distance(surface, i, j);
    const digits = decimals(sigma);
    const spread = Number.isNaN(sigma) ? "" : ` ± ${sigma.toFixed(digits)}`;
    const units = [lateral, lateral, unit];
    const rows = units.map((own, k) => [`Δ${"xyz"[k]}`, `${offset[k].toFixed(digits)} ${own}`]);
    if (metric) rows.unshift(["Distance", `${length.toFixed(digits)}${spread} ${unit}`]);
    this.tell(rows);
    if (!metric || !surface.raster) return;
    this.ui.chart.hidden = false;
    this.samples = profile(surface, i, j);
    drawChart(this.ui.chart, this.samples, unit, digits);
  }

  /** Fit a body to the measured points that are shown in a rectangle of the stage. */
  region([x0, y0, x1, y1]) {
    const { view, active } = this.viewer;
    const [left, right] = [Math.min(x0, x1), Math.max(x0, x1)];
    const [top, bottom] = [Math.min(y0, y1), Math.max(y0, y1)];
    const panel = Math.min(Math.floor(left / view.width), active.length - 1);
    const surface = active[panel];
    const shows = this.viewer.shows(surface);
    const pixels = [];
    for (let i = 0; i < surface.reason.length; i++) {
      if (surface.reason[i] || !shows(i)) continue;
      const [x, y] = view.project(surface.shown.subarray(3 * i, 3 * i + 3));
      const across = x + panel * view.width;
      if (across >= left && across <= right && y >= top && y <= bottom) pixels.push(i);
    }
    this.corner = null;
    this.frame = [left, top, right, bottom];
    this.chosen = { surface, pixels };
    this.fitBody();
  }

  fitBody() {
    if (!this.chosen) return;
    const { surface, pixels } = this.chosen;
    const { kind, metric } = surface.header;
    const towards = [0, 0, kind === "cloud" || kind === "points" ? -1 : 1];
    const at = (k) => surface.points[3 * pixels[(k / 3) | 0] + (k % 3)];
    try {
      if (!metric) throw new Error("A fit needs coordinates in mm; this surface has none.");
      const points = filled(Float64Array, 3 * pixels.length, at);
      this.tellFit(fitRegion(points, this.ui.body.value, towards), surface, pixels);
    } catch (error) {
      this.tell([["No fit", error.message]]);
    }
  }

  tellFit(result, surface, pixels) {
    this.result = result;
    const { unit } = surface.header;
    const digits = decimals(result.deviation);
    const list = (values) => `${values.map((v) => v.toFixed(digits)).join(", ")} ${unit}`;
    const rows = [["Points", result.points.toLocaleString("en")]];
    if (result.normal) rows.push(["Normal", result.normal.map((v) => v.toFixed(5)).join(", ")]);
    if (result.point) rows.push(["Point", list(result.point)]);
    if (result.centre) rows.push(["Centre", list(result.centre)]);
    if (result.radius) {
      const spread = result.radiusSigma.toPrecision(2);
      rows.push(["Radius", `${result.radius.toFixed(digits + 1)} ± ${spread} ${unit}`]);
    }
    rows.push(["Standard deviation", `${result.deviation.toPrecision(3)} ${unit}`]);
    rows.push(["Range of 99.7 %", `${result.range.toPrecision(3)} ${unit}`]);
    this.tell(rows);
    const values = new Float32Array(surface.reason.length).fill(NaN);
    for (const [k, i] of pixels.entries()) values[i] = result.distances[k];
    this.viewer.addLayer(surface, { name: "fit", unit, values });
  }

  tell(rows) {
    const cells = rows.flatMap(([name, value]) => [make("dt", name), make("dd", value)]);
    this.ui.result.replaceChildren(...cells);
  }
}
