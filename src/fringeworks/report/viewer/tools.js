// What the viewer reads and measures at the cursor: values, distances with profiles, fitted bodies.

import { LAYERS } from "./assets.js";
import { fitRegion } from "./fit.js";
import { between, distance, pointAt, profile } from "./measure.js";
import { within } from "./mesh.js";
import { decimals, fixed, make, number, sigmaText } from "./numbers.js";

const REACH_PX = [6, 40]; // how far from a point the cursor may be; more between sparse points
const BEHIND = 1e6; // added to the distance of pixels without a value: measured ones come first
const POINT_MM = 0.01; // σ whose digits places have that have none: whole micrometres
const CHART_ROOM = 0.06; // above and below a profile, share of its range
const HINTS = {
  turn: "",
  distance: "Pick two points.",
  flag: "Pick points: each gets a flag with its value. Pick a flag's point again to take it away.",
  region: "Drag a rectangle, or pick two corners. All points in it count that are not clipped.",
};

export class Tools {
  constructor(viewer) {
    Object.assign(this, { viewer, ui: viewer.ui });
  }

  /** turn, distance or region. */
  get name() {
    return this.ui.panel.elements.tool.value;
  }

  /** Another tool. */
  change() {
    this.ui.hint.textContent = HINTS[this.name];
    this.ui.bodyRow.hidden = this.name !== "region";
    this.forget();
  }

  forget() {
    this.picks = [];
    this.corner = this.frame = this.chosen = null;
    this.ui.result.replaceChildren();
    this.ui.chart.hidden = true;
    this.viewer.drawOver();
  }

  /** The surface of the panel at a place of the stage, and the panel's left side. */
  panelAt(x) {
    const { active, view } = this.viewer;
    const panel = Math.min(Math.floor(x / view.width), active.length - 1);
    return { surface: active[panel], from: panel * view.width };
  }

  /** The surface and the pixel of it at a place of the stage, −1 for none: of those near it a
   * measured one, the nearest, and the one in front. */
  at(x, y) {
    const { view } = this.viewer;
    const { surface, from } = this.panelAt(x);
    const shows = this.viewer.shows(surface);
    const reach = Math.min(Math.max(REACH_PX[0], view.spacing), REACH_PX[1]);
    const place = [Math.floor(x - from), Math.floor(y)];
    let best = { surface, pixel: -1, far: BEHIND + reach ** 2, front: -Infinity };
    const [left, top] = place.map((v) => v - reach);
    const area = [left, top, left + 2 * reach + 1, top + 2 * reach + 1];
    within(surface, view.toScreen, area, (pixel, column, row, front) => {
      const apart = (Math.floor(column) - place[0]) ** 2 + (Math.floor(row) - place[1]) ** 2;
      const far = apart + (surface.reason[pixel] ? BEHIND : 0);
      if (apart > reach ** 2 || far > best.far || (far === best.far && front <= best.front)) return;
      if (shows(pixel)) best = { surface, pixel, far, front };
    });
    return best;
  }

  inspect(x, y) {
    const { surface, pixel } = this.at(x, y);
    this.viewer.say(pixel < 0 ? "Nothing here." : this.describe(surface, pixel));
    if (surface === this.viewer.surfaces[0]) this.viewer.point(pixel);
  }

  /** A pixel in words: its point, σ and maps; or why it has no value and what to change. */
  describe(surface, i) {
    const { header, width, reason, sigma, layers } = surface;
    const { raster, unit, lateral_unit: lateral } = header;
    const place = raster ? `column ${i % width}, row ${Math.floor(i / width)}` : `point ${i}`;
    if (reason[i]) {
      const { label, meaning, advice } = header.reasons[reason[i]];
      return `${place}: no value (${label}): ${meaning}. What to do: ${advice}.`;
    }
    const [x, y, z] = pointAt(surface, i).map((v) => number(v, sigma[i] || POINT_MM));
    const known = Number.isNaN(sigma[i]) ? "unknown" : `${sigmaText(sigma[i])} ${unit}`;
    const parts = [`${place}: x ${x}, y ${y} ${lateral}, z ${z} ${unit}, σ ${known}`];
    for (const { name, values, packed, unit: own } of layers) {
      const { told, label } = LAYERS[name];
      if (!told || packed || Number.isNaN(values[i])) continue;
      const text = number(values[i], own === unit ? sigma[i] : NaN);
      parts.push(`${label.toLowerCase()} ${text} ${own}`);
    }
    return parts.join(", ");
  }

  /** A click, or Enter at the crosshair. */
  pick(x, y) {
    this.inspect(x, y);
    if (this.name === "distance") this.pickPoint(this.at(x, y));
    else if (this.name === "region" && this.corner) this.region([...this.corner, x, y]);
    else if (this.name === "region") this.corner = [x, y];
    else if (this.name === "flag") this.flag(this.at(x, y));
    this.viewer.drawOver();
  }

  /** Put a flag with the value of the shown layer on a point, or take it away. */
  flag({ surface, pixel }) {
    if (pixel < 0 || surface.reason[pixel]) return;
    const { header, layers, sigma } = surface;
    const flags = header.flags ?? [];
    const shown = this.viewer.layer.name;
    const { values, unit } = layers.find(({ name }) => name === shown) ?? layers[0];
    const text = `${number(values[pixel], unit === header.unit ? sigma[pixel] : NaN)} ${unit}`;
    const others = flags.filter(([i]) => i !== pixel);
    header.flags = others.length < flags.length ? others : [...flags, [pixel, text.trim()]];
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
    const { metric, raster, unit, lateral_unit: lateral } = surface.header;
    const { length, offset, sigma } = distance(surface, ...this.picks);
    const digits = decimals(sigma || POINT_MM);
    const spread = Number.isNaN(sigma) ? "" : ` ± ${sigmaText(sigma)}`;
    const units = [lateral, lateral, unit];
    const rows = units.map((own, k) => [`Δ${"xyz"[k]}`, `${fixed(offset[k], digits)} ${own}`]);
    if (metric) rows.unshift(["Distance", `${fixed(length, digits)}${spread} ${unit}`]);
    this.tell(rows);
    if (metric && raster) this.chart(profile(surface, ...this.picks), unit, digits);
  }

  /** Draw a profile: heights with a band of ± σ over the distance along the line. */
  chart(samples, unit, digits) {
    const { ui } = this;
    this.samples = samples;
    this.along = between(this.owner, ...this.picks);
    this.digits = digits;
    const known = samples.filter(([along]) => !Number.isNaN(along));
    const [alongs, heights] = [0, 1].map((k) => known.map((values) => values[k]));
    const [left, right] = [Math.min(...alongs), Math.max(...alongs)];
    const [low, high] = [Math.min(...heights), Math.max(...heights)];
    const [line, band] = ui.curves.children;
    const pen = (k) => (k && !Number.isNaN(samples[k - 1][0]) ? "L" : "M");
    const path = samples.map(([x, y], k) => (Number.isNaN(x) ? "" : `${pen(k)}${x} ${-y}`));
    line.setAttribute("d", path.join(""));
    const reach = ([x, y, sigma]) => `M${x} ${-y - (sigma || 0)}V${(sigma || 0) - y}`;
    band.setAttribute("d", known.map(reach).join(""));
    const room = CHART_ROOM * (high - low || 1e-9);
    const size = `${right - left || 1} ${(high - low || 1e-9) + 2 * room}`;
    ui.curves.setAttribute("viewBox", `${left} ${-high - room} ${size}`);
    this.chartBox = [-high - room, high - low + 2 * room];
    this.cursorAt(-1);
    ui.chartTop.textContent = `Height over the line A–B: ${fixed(high, digits)} ${unit}`;
    ui.chartLow.textContent = fixed(low, digits);
    ui.chartEnd.textContent = `B, ${fixed(right, digits)} ${unit}`;
    ui.chart.hidden = false;
  }

  /** A place of the profile is pointed at: its values, and its point on the surface. */
  slide({ offsetX }) {
    const share = Math.min(Math.max(offsetX / this.ui.curves.clientWidth, 0), 1);
    const { x, width } = this.ui.curves.viewBox.baseVal;
    const far = ([along]) => (Number.isNaN(along) ? Infinity : Math.abs(along - x - share * width));
    const best = this.samples.reduce((k, one, n, all) => (far(one) < far(all[k]) ? n : k), 0);
    this.viewer.point(this.along[best]);
  }

  /** Mark a pixel in the profile, if it has it. */
  cursorAt(pixel) {
    if (this.ui.chart.hidden || !this.along) return;
    const k = this.along.indexOf(pixel);
    const [x, y, sigma] = this.samples[k] ?? [NaN];
    const [top, height] = this.chartBox;
    const there = !Number.isNaN(x);
    this.ui.curves.children[2].setAttribute("d", there ? `M${x} ${top}v${height}` : "");
    const unit = this.owner.header.unit;
    const spread = there && !Number.isNaN(sigma) ? ` ± ${sigmaText(sigma)}` : "";
    const [along, over] = [x, y].map((v) => fixed(v, this.digits));
    this.ui.chartAt.textContent = there ? `${along} ${unit}: ${over}${spread} ${unit}` : "";
  }

  /** Fit a body to the measured points that are shown in a rectangle of the stage. */
  region([x0, y0, x1, y1]) {
    const [left, right] = [Math.min(x0, x1), Math.max(x0, x1)];
    const [top, bottom] = [Math.min(y0, y1), Math.max(y0, y1)];
    const { surface, from } = this.panelAt(left);
    const shows = this.viewer.shows(surface);
    const pixels = [];
    const area = [left - from, top, right - from, bottom];
    within(surface, this.viewer.view.toScreen, area, (i) => {
      if (!surface.reason[i] && shows(i)) pixels.push(i);
    });
    this.corner = null;
    this.frame = [left, top, right, bottom];
    this.chosen = { surface, pixels };
    this.fitBody();
  }

  fitBody() {
    if (!this.chosen) return;
    const { surface, pixels } = this.chosen;
    try {
      if (!surface.header.metric) throw new Error("A fit needs coordinates in mm.");
      const points = pixels.map((i) => pointAt(surface, i));
      const towards = [0, 0, surface.header.away ? -1 : 1];
      this.tellFit(fitRegion(points, this.ui.body.value, towards), surface, pixels);
    } catch (error) {
      this.tell([["No fit", error.message]]);
    }
  }

  tellFit(result, surface, pixels) {
    this.result = result;
    const { unit } = surface.header;
    const { points, normal, point, centre, radius, radiusSigma, deviation, range } = result;
    const digits = decimals(deviation);
    const list = (values) => `${values.map((v) => fixed(v, digits)).join(", ")} ${unit}`;
    const rows = [
      ["Points", points.toLocaleString("en")],
      ["Normal", normal?.map((v) => fixed(v, 5)).join(", ")],
      ["Point", point && list(point)],
      ["Centre", centre && list(centre)],
      ["Radius", radius && `${number(radius, radiusSigma)} ± ${sigmaText(radiusSigma)} ${unit}`],
      ["Standard deviation", `${number(deviation)} ${unit}`],
      ["Range of 99.7 %", `${number(range)} ${unit}`],
    ];
    this.tell(rows.filter(([, text]) => text));
    const values = new Float32Array(surface.reason.length).fill(NaN);
    for (const [k, i] of pixels.entries()) values[i] = result.distances[k];
    this.viewer.addLayer(surface, { name: "fit", unit, values });
  }

  tell(rows) {
    const cells = rows.flatMap(([name, value]) => [make("dt", name), make("dd", value)]);
    this.ui.result.replaceChildren(...cells);
  }
}
