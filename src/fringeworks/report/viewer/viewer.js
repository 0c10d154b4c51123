// The viewer: controls, mouse, touch and keys around a Scene. The settings are the controls' values.

import { LAYERS, SCALES, TEMPLATE, VIEWS } from "./assets.js";
import * as measure from "./measure.js";
import { drawChart, drawHistogram, drawOver, ink } from "./overlay.js";
import { Scene } from "./scene.js";
import { unpack } from "./unpack.js";
import { View } from "./view.js";

const REST_MS = 160; // after the last movement, until all points are drawn
const FIRST_POINTS = 120_000; // of a picture while the view moves, before its speed is known
const SLOW_MS = 70; // a frame that takes longer makes the moving raster coarser …
const FAST_MS = 24; // … a shorter one makes it finer
const STEPS = 1000; // of range handles and clip planes
const CLICK_PX = 4; // a drag that is shorter is a click
const REACH_PX = 6; // how far from a point the cursor may be
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** A viewer in an element. Its payloads are those given, or the scripts in the element. */
export class FringeViewer {
  constructor(element, payloads = null) {
    const own = [...element.querySelectorAll("script[type='application/x-fringeworks-surface']")];
    this.root = make("div", "", { className: "fringe-viewer" });
    this.root.innerHTML = TEMPLATE; // a constant of this script, without any data
    element.append(this.root);
    this.ui = {};
    for (const part of this.root.querySelectorAll("[data-ui]")) this.ui[part.dataset.ui] = part;
    this.ready = this.start(payloads ?? own.map((script) => script.textContent)).catch((error) => {
      this.ui.readout.setAttribute("role", "alert");
      this.say(error.message);
    });
  }

  async start(payloads) {
    this.scene = new Scene(this.ui.picture);
    this.surfaces = [];
    for (const payload of payloads) this.surfaces.push(await unpack(payload));
    if (!this.surfaces.length) throw new Error("There is no surface in this page.");
    const [{ header, reason }] = this.surfaces;
    this.box = measure.bounds(this.surfaces[0]);
    for (const surface of this.surfaces) this.prepare(surface);
    this.ui.showRow.hidden = this.surfaces.length < 2;
    this.stride = Math.max(1, Math.ceil(Math.sqrt(reason.length / FIRST_POINTS)));
    const flipped = header.kind === "cloud" || header.kind === "points";
    this.view = new View(flipped, this.box, header.stretch, this.surfaces[0].mesh.side);
    this.pointers = new Map();
    this.picks = [];
    this.addClips();
    this.choose("one");
    this.listen();
    this.turnTo(VIEWS.length - 1);
    this.say(header.count ? "Point at the surface to read a value." : "No pixel has a value.");
    if (!header.count) this.list("reason");
    this.draw();
    performance.mark("fringe-viewer-picture");
  }

  say(text) {
    this.ui.readout.textContent = text;
  }

  /** Places for the screen, about the first surface's middle, and the layers to colour by. */
  prepare(surface) {
    const { points, header, reason, sigma } = surface;
    const { centre } = this.box;
    const stretch = [1, 1, header.stretch];
    surface.shown = Float32Array.from(points, (v, i) => (v - centre[i % 3]) * stretch[i % 3]);
    const own = { sigma, plain: new Float32Array(reason.length), reason: Float32Array.from(reason) };
    own[header.kind] = Float32Array.from(reason, (code, i) => (code ? NaN : points[3 * i + 2]));
    for (const [name, values] of Object.entries(own)) {
      const unit = name === "sigma" || name === header.kind ? header.unit : "";
      surface.layers.push({ name, values, unit });
    }
    const order = Object.keys(LAYERS);
    surface.layers.sort((a, b) => order.indexOf(a.name) - order.indexOf(b.name));
    surface.mesh = this.scene.add(surface);
  }

  /** Show one result, both, or their difference. */
  choose(what) {
    const [one, other] = this.surfaces;
    if (what === "difference" && !this.gap) {
      const gap = measure.difference(one, other);
      this.prepare(gap);
      this.gap = gap;
    }
    const sets = { one: [one], other: [other], both: [one, other], difference: [this.gap] };
    this.active = sets[what];
    this.tell();
    this.list(what === "difference" ? "difference" : this.ui.layer.value);
    this.forgetPicks();
    this.resize();
  }

  /** Title, counts and notes: always as text, never as markup. */
  tell() {
    const { ui, active } = this;
    const { notes, note_count: all } = active[0].header;
    const summary = ({ count, size: [w, h] }) =>
      `${count.toLocaleString("en")} points, ${percent(count / (w * h))} of ${w} × ${h}`;
    ui.title.textContent = active.map(({ header }) => header.title || "Surface").join(" | ");
    ui.summary.textContent = active.map(({ header }) => summary(header)).join(" | ");
    const shown = all > notes.length ? [...notes, `… and ${all - notes.length} more notes`] : notes;
    ui.notesBox.hidden = !all;
    ui.notesTitle.textContent = `Notes (${all})`;
    ui.notes.replaceChildren(...shown.map((note) => make("li", note)));
  }

  /** Fill the list of layers, choose one and colour by it. */
  list(wanted) {
    const { layers } = this.active[0];
    this.ui.layer.replaceChildren(...layers.map(({ name }) => new Option(LAYERS[name].label, name)));
    this.ui.layer.value = layers.some(({ name }) => name === wanted) ? wanted : layers[0].name;
    this.colour();
  }

  colour() {
    const { ui, scene } = this;
    this.layer = this.active[0].layers.find(({ name }) => name === ui.layer.value);
    this.kind = LAYERS[this.layer.name];
    this.mode = this.layer.packed ? 2 : this.kind.mode;
    for (const { layers, mesh } of this.active) {
      scene.setValues(mesh, (layers.find(({ name }) => name === this.layer.name) ?? layers[0]).values);
    }
    scene.setScale(this.kind.scale);
    ui.scale.hidden = this.mode !== 1;
    ui.legend.hidden = this.mode !== 3;
    [ui.low.value, ui.high.value] = [0, STEPS];
    this.spread = measure.spread(this.layer.values, this.kind.scale === "signed");
    if (this.mode === 3) this.tellReasons();
    this.rangeChanged();
  }

  /** Ends of the colour scale. */
  get range() {
    const { low, high } = this.spread;
    return [this.ui.low, this.ui.high].map(({ value }) => low + ((high - low) * value) / STEPS);
  }

  rangeChanged() {
    const { ui, kind, layer, spread } = this;
    if (Number(ui.low.value) >= Number(ui.high.value)) ui.low.value = Number(ui.high.value) - 1;
    const digits = decimals((spread.high - spread.low) / 10);
    const texts = this.range.map((v) => v.toFixed(digits));
    [ui.lowText.textContent, ui.highText.textContent] = texts;
    ui.unitText.textContent = layer.unit ? `${kind.label}, ${layer.unit}` : kind.label;
    for (const [k, input] of [ui.low, ui.high].entries()) {
      input.setAttribute("aria-valuetext", `${texts[k]} ${layer.unit}`);
    }
    this.move();
  }

  /** The legend of the reasons: share, meaning, and what to change. */
  tellReasons() {
    const { header, reason } = this.active[0];
    const counts = new Array(header.reasons.length).fill(0);
    for (const code of reason) counts[code]++;
    const rows = header.reasons.map(({ label, meaning, advice }, code) => {
      const row = make("li", `${label} ${percent(counts[code] / reason.length)}`);
      const swatch = make("i");
      swatch.style.background = `#${SCALES.reasons[code]}`;
      row.prepend(swatch);
      if (code) row.append(make("small", `${meaning}: ${advice}`));
      return row;
    });
    this.ui.legend.replaceChildren(...rows.filter((_, code) => counts[code]));
  }

  addClips() {
    const places = ["x", "y", "z"].flatMap((axis, k) => [[axis, k, "from"], [axis, k, "to"]]);
    this.clips = places.map(([axis, k, end]) => {
      const value = end === "to" ? STEPS : 0;
      const input = make("input", "", { type: "range", min: 0, max: STEPS, value });
      const label = make("label", `${axis} ${end} `);
      label.append(input);
      this.ui.clips.append(label);
      return { input, k, end };
    });
  }

  /** Ends of the clipped box in the screen's coordinates; a handle at its end does not clip. */
  clipEnds(end) {
    const { half } = this.box;
    return this.clips.filter((clip) => clip.end === end).map(({ input, k }) => {
      if (input.value === (end === "to" ? String(STEPS) : "0")) return end === "to" ? 1e9 : -1e9;
      const stretch = k === 2 ? this.active[0].header.stretch : 1;
      return ((2 * input.value) / STEPS - 1) * half[k] * stretch * 1.02;
    });
  }

  /** What a picture depends on besides the view. */
  get look() {
    const { ui, kind, mode } = this;
    const colour = (name) => ink(ui.picture, name).split(" ").map((v) => v / 255);
    return {
      mode,
      range: kind.flip ? this.range.toReversed() : this.range,
      low: this.clipEnds("from"),
      high: this.clipEnds("to"),
      light: ui.light.checked,
      points: ui.points.checked,
      gaps: ui.gaps.checked || mode === 3,
      hide: ui.hide.checked,
      plain: colour("--plain-rgb"),
      gapColour: colour("--gap-rgb"),
      background: colour("--stage-rgb"),
    };
  }

  get meshes() {
    return this.active.map(({ mesh }) => mesh);
  }

  /** The view or the look has changed: draw coarsely now, and all points after a while. */
  move() {
    this.map = null;
    this.frame ??= requestAnimationFrame((time) => {
      this.frame = null;
      this.adapt(time);
      this.draw();
    });
    clearTimeout(this.rest);
    this.rest = setTimeout(() => {
      this.last = null;
      this.scene.refine(this.meshes, this.view, this.look, () => performance.mark("fringe-viewer-all"));
    }, REST_MS);
  }

  /** Keep the time of a moving frame between fast and slow. */
  adapt(time) {
    const took = time - (this.last ?? time);
    if (took > SLOW_MS) this.stride++;
    else if (took > 0 && took < FAST_MS && this.stride > 1) this.stride--;
    this.last = time;
  }

  draw() {
    this.scene.draw(this.meshes, this.view, this.look, this.stride);
    this.drawOver();
    const [low, high] = [this.ui.low, this.ui.high].map(({ value }) => value / STEPS);
    if (this.mode === 1) drawHistogram(this.ui.histogram, this.spread.bins, this.kind, low, high);
  }

  drawOver() {
    const { view, active, cross, drag } = this;
    const { header } = active[0];
    const names = active.length > 1 ? ["A", "B"] : null;
    const picks = this.picks.map((i) => ({ at: active[0].shown.subarray(3 * i, 3 * i + 3) }));
    const frame = drag?.frame ?? this.frameKept;
    drawOver(this.ui.overlay, { view, active, picks, frame, cross, names, unit: header.lateral_unit });
  }

  resize() {
    const { clientWidth, clientHeight } = this.ui.stage;
    this.view.resize(Math.floor(clientWidth / this.active.length), clientHeight);
    this.ui.picture.width = Math.round(clientWidth * this.view.density);
    this.ui.picture.height = Math.round(clientHeight * this.view.density);
    this.move();
  }

  turnTo(k) {
    this.view.turnTo(...VIEWS[k]);
    this.view.fit();
    this.move();
  }

  // ---- reading values -----------------------------------------------------------------------

  /** The surface of a panel and the pixel of it that is at a place of the stage, −1 for none. */
  at(x, y) {
    const panel = Math.min(Math.floor(x / this.view.width), this.active.length - 1);
    const surface = this.active[panel];
    this.map ??= this.active.map((one) => measure.pickMap(one, this.view, this.shows(one)));
    const reach = Math.min(Math.max(REACH_PX, Math.ceil(this.view.spacing)), 40);
    const [column, row] = [Math.floor(x - panel * this.view.width), Math.floor(y)];
    return { surface, pixel: measure.pick(this.map[panel], column, row, reach) };
  }

  /** Which pixels are neither clipped nor hidden. */
  shows({ shown, layers }) {
    const { low, high, hide, mode } = this.look;
    const values = layers.find(({ name }) => name === this.layer.name)?.values;
    const [from, to] = this.range;
    const outside = (v) => v < from || v > to;
    return (i) => {
      for (let k = 0; k < 3; k++) {
        if (shown[3 * i + k] < low[k] || shown[3 * i + k] > high[k]) return false;
      }
      return !(hide && mode === 1 && values && outside(values[i]));
    };
  }

  inspect(x, y) {
    const { surface, pixel } = this.at(x, y);
    this.say(pixel < 0 ? "Nothing here." : this.describe(surface, pixel));
  }

  /** A pixel in words: its point, σ and maps; or why it has no value and what to change. */
  describe(surface, i) {
    const { header, width, reason, sigma, raster, layers } = surface;
    const { unit, lateral_unit: lateral } = header;
    const place = raster ? `column ${i % width}, row ${Math.floor(i / width)}` : `point ${i}`;
    if (reason[i]) {
      const { label, meaning, advice } = header.reasons[reason[i]];
      return `${place}: no value (${label}): ${meaning}. What to do: ${advice}.`;
    }
    const digits = Number.isNaN(sigma[i]) ? 4 : decimals(sigma[i]);
    const [x, y, z] = measure.pointAt(surface, i).map((v) => v.toFixed(digits));
    const known = Number.isNaN(sigma[i]) ? "unknown" : `${sigma[i].toPrecision(2)} ${unit}`;
    const parts = [`${place}: x ${x}, y ${y} ${lateral}, z ${z} ${unit}, σ ${known}`];
    for (const { name, values, packed, unit: own } of layers) {
      const told = LAYERS[name].told && !packed && !Number.isNaN(values[i]);
      if (told) parts.push(`${LAYERS[name].label.toLowerCase()} ${values[i].toPrecision(4)} ${own}`);
    }
    return parts.join(", ");
  }

  // ---- measuring ----------------------------------------------------------------------------

  get tool() {
    return this.ui.panel.elements.tool.value;
  }

  toolChanged() {
    const hints = { turn: "", distance: "Pick two points.", region: "Drag a rectangle, or pick two corners." };
    this.ui.hint.textContent = hints[this.tool];
    this.ui.bodyRow.hidden = this.tool !== "region";
    this.forgetPicks();
    this.drawOver();
  }

  forgetPicks() {
    this.picks = [];
    this.corner = this.frameKept = null;
    this.ui.result.replaceChildren();
    this.ui.chart.hidden = true;
  }

  /** A click, or Enter at the crosshair. */
  pick(x, y) {
    this.inspect(x, y);
    if (this.tool === "region") {
      if (this.corner) this.region([...this.corner, x, y]);
      else this.corner = [x, y];
    }
    if (this.tool === "distance") this.pickPoint(this.at(x, y));
    this.drawOver();
  }

  pickPoint({ surface, pixel }) {
    if (pixel < 0 || surface.reason[pixel]) return;
    if (this.picks.length === 2) this.forgetPicks();
    this.picks.push(pixel);
    if (this.picks.length === 2 && this.picks[0] !== this.picks[1]) this.tellDistance(surface);
  }

  tellDistance(surface) {
    const [i, j] = this.picks;
    const { metric, unit, lateral_unit: lateral } = surface.header;
    const { length, offset, sigma } = measure.distance(surface, i, j);
    const digits = Number.isNaN(sigma) ? 4 : decimals(sigma);
    const rows = [0, 1, 2].map((k) => [`Δ${"xyz"[k]}`, offset[k].toFixed(digits), k < 2 ? lateral : unit]);
    if (metric) rows.unshift(["Distance", `${length.toFixed(digits)} ± ${sigma.toFixed(digits)}`, unit]);
    this.tellResult(rows);
    if (!metric || !surface.raster) return;
    this.ui.chart.hidden = false;
    drawChart(this.ui.chart, measure.profile(surface, i, j), unit, digits);
  }

  /** Fit a body to the measured points that are shown in a rectangle of the stage. */
  region(frame) {
    const { view } = this;
    const [left, right] = [frame[0], frame[2]].sort((a, b) => a - b);
    const [top, bottom] = [frame[1], frame[3]].sort((a, b) => a - b);
    const panel = Math.min(Math.floor(left / view.width), this.active.length - 1);
    const surface = this.active[panel];
    const shows = this.shows(surface);
    const pixels = [];
    for (let i = 0; i < surface.reason.length; i++) {
      if (surface.reason[i] || !shows(i)) continue;
      const [x, y] = view.project(surface.shown.subarray(3 * i, 3 * i + 3));
      const across = x + panel * view.width;
      if (across >= left && across <= right && y >= top && y <= bottom) pixels.push(i);
    }
    this.corner = null;
    this.frameKept = [left, top, right, bottom];
    this.fit = { surface, pixels };
    this.fitBody();
  }

  fitBody() {
    if (!this.fit) return;
    const { surface, pixels } = this.fit;
    const { header } = surface;
    try {
      if (!header.metric) throw new Error("A fit needs coordinates in mm; this surface has none.");
      const points = Float64Array.from({ length: 3 * pixels.length }, (_, k) =>
        surface.points[3 * pixels[(k / 3) | 0] + (k % 3)],
      );
      const towards = [0, 0, header.kind === "cloud" || header.kind === "points" ? -1 : 1];
      this.tellFit(measure.fitRegion(points, this.ui.body.value, towards), surface, pixels);
    } catch (error) {
      this.tellResult([["No fit", error.message, ""]]);
    }
  }

  tellFit(result, surface, pixels) {
    this.result = result;
    const { unit } = surface.header;
    const digits = decimals(result.deviation);
    const list = (values) => values.map((v) => v.toFixed(digits)).join(", ");
    const rows = [["Points", result.points.toLocaleString("en"), ""]];
    if (result.normal) rows.push(["Normal", result.normal.map((v) => v.toFixed(5)).join(", "), ""]);
    if (result.point) rows.push(["Point", list(result.point), unit]);
    if (result.centre) rows.push(["Centre", list(result.centre), unit]);
    const { radius, radiusSigma } = result;
    if (radius) rows.push(["Radius", `${radius.toFixed(digits + 1)} ± ${radiusSigma.toPrecision(2)}`, unit]);
    rows.push(["Standard deviation", result.deviation.toPrecision(3), unit]);
    rows.push(["Range of 99.7 %", result.range.toPrecision(3), unit]);
    this.tellResult(rows);
    const values = new Float32Array(surface.reason.length).fill(NaN);
    for (const [k, i] of pixels.entries()) values[i] = result.distances[k];
    surface.layers = surface.layers.filter(({ name }) => name !== "fit");
    surface.layers.push({ name: "fit", unit, values });
    this.list(this.ui.layer.value);
  }

  tellResult(rows) {
    const cells = rows.flatMap(([name, value, unit]) => [make("dt", name), make("dd", `${value} ${unit}`)]);
    this.ui.result.replaceChildren(...cells);
  }

  // ---- input --------------------------------------------------------------------------------

  listen() {
    const { ui, root } = this;
    root.addEventListener("input", ({ target }) => this.changed(target));
    root.addEventListener("keydown", (event) => this.key(event));
    ui.panel.addEventListener("submit", (event) => event.preventDefault());
    for (const button of root.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => this.turnTo(Number(button.dataset.view)));
    }
    ui.fit.addEventListener("click", () => this.fitView());
    ui.cross.addEventListener("click", () => this.toggleCross());
    const stage = ui.picture;
    stage.addEventListener("dblclick", () => this.fitView());
    stage.addEventListener("contextmenu", (event) => event.preventDefault());
    stage.addEventListener("pointerdown", (event) => this.press(event));
    stage.addEventListener("pointermove", (event) => this.drags(event));
    for (const name of ["pointerup", "pointercancel"]) {
      stage.addEventListener(name, (event) => this.release(event));
    }
    stage.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    new ResizeObserver(() => this.resize()).observe(ui.stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.move());
  }

  changed(target) {
    const { ui } = this;
    if (target === ui.layer) this.colour();
    else if (target === ui.low || target === ui.high) this.rangeChanged();
    else if (target === ui.body) this.fitBody();
    else if (target.name === "tool") this.toolChanged();
    else if (target === ui.show) this.tryChoose(target);
    else this.move();
  }

  tryChoose(select) {
    try {
      this.choose(select.value);
    } catch (error) {
      this.say(error.message);
      select.value = "one";
      this.choose("one");
    }
  }

  fitView() {
    this.view.fit();
    this.move();
  }

  toggleCross() {
    this.cross = this.cross ? null : [Math.round(this.view.width / 2), Math.round(this.view.height / 2)];
    this.ui.picture.focus();
    this.drawOver();
    if (this.cross) this.inspect(...this.cross);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const own = event.target === this.ui.picture;
    const arrow = own && ARROWS[event.key];
    const control = this.root.querySelector(`[data-key="${CSS.escape(event.key.toLowerCase())}"]`);
    if (arrow) this.arrow(arrow, event.shiftKey);
    else if (own && "+=-_".includes(event.key)) this.zoom("+=".includes(event.key) ? 1.2 : 1 / 1.2);
    else if (own && event.key === "Enter" && this.cross) this.pick(...this.cross);
    else if (event.key === "Escape" && this.cross) this.toggleCross();
    else if (control && event.target.tagName !== "SELECT") control.click();
    else return;
    event.preventDefault();
  }

  arrow([x, y], shift) {
    if (this.cross) {
      const step = shift ? 1 : 10;
      const { width, height } = this.view;
      const limit = [width * this.active.length - 1, height - 1];
      this.cross = [x, y].map((v, k) => Math.min(Math.max(this.cross[k] + step * v, 0), limit[k]));
      this.drawOver();
      this.inspect(...this.cross);
      return;
    }
    if (shift) this.view.pan(-30 * x, -30 * y);
    else this.view.turnBy(15 * x, 15 * y);
    this.move();
  }

  zoom(factor, x = this.view.width / 2, y = this.view.height / 2) {
    this.view.zoom(factor, x, y);
    this.move();
  }

  wheel(event) {
    // A viewer in a longer page must not catch the wheel of somebody who scrolls past it.
    if (!this.root.contains(document.activeElement)) return;
    event.preventDefault();
    this.zoom(Math.exp(-0.0015 * event.deltaY), event.offsetX % this.view.width, event.offsetY);
  }

  press(event) {
    this.ui.picture.focus();
    this.ui.picture.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    const from = [event.offsetX, event.offsetY];
    const pans = event.button === 2 || event.button === 1 || event.shiftKey;
    this.drag = { from, pans, moved: this.pointers.size > 1, frames: this.tool === "region" && !pans };
  }

  drags(event) {
    const [x, y] = [event.offsetX, event.offsetY];
    const last = this.pointers.get(event.pointerId);
    if (!last) {
      if (!this.cross) this.inspect(x, y);
      return;
    }
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, [x, y]);
    const { drag, view } = this;
    drag.moved ||= Math.hypot(x - drag.from[0], y - drag.from[1]) > CLICK_PX;
    if (!drag.moved) return;
    const [dx, dy] = [x - last[0], y - last[1]];
    if (drag.frames && !other) {
      drag.frame = [...drag.from, x, y];
      this.drawOver();
      return;
    }
    if (other) {
      const size = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      view.pan(dx / 2, dy / 2);
      view.zoom(size([x, y]) / Math.max(size(last), 1), (x + other[0]) / 2, (y + other[1]) / 2);
    } else if (drag.pans) view.pan(dx, dy);
    else view.turnBy(dx, dy);
    this.move();
  }

  release(event) {
    const { drag } = this;
    this.pointers.delete(event.pointerId);
    if (this.pointers.size || !drag) return;
    this.drag = null;
    if (drag.frame) this.region(drag.frame);
    else if (!drag.moved && event.type === "pointerup") this.pick(event.offsetX, event.offsetY);
    this.drawOver();
  }
}

/** An element with text; text is never markup. */
function make(tag, text = "", properties = {}) {
  return Object.assign(document.createElement(tag), { textContent: text }, properties);
}

const percent = (share) => `${(100 * share).toFixed(1)} %`;

/** Digits after the point so that a number with this σ is not cut. */
function decimals(sigma) {
  return Math.min(Math.max(Math.ceil(-Math.log10(sigma || 1)) + 1, 0), 7);
}
