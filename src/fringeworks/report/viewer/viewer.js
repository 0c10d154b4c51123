// The viewer: its surfaces, its controls and its picture. The settings are the controls' values.

import { LAYERS, SCALES, TEMPLATE, VIEWS } from "./assets.js";
import { Clips } from "./clips.js";
import { Input } from "./input.js";
import { difference } from "./measure.js";
import { bounds, decimals, filled, make, spread } from "./numbers.js";
import { drawHistogram, drawOver, ink } from "./overlay.js";
import { Scene } from "./scene.js";
import { Tools } from "./tools.js";
import { unpack } from "./unpack.js";
import { View } from "./view.js";

const REST_MS = 160; // after the last movement, until all points are drawn
const FIRST_POINTS = 120_000; // of a picture while the view moves, before its speed is known
const SLOW_MS = 90; // a frame that takes longer makes the moving raster coarser …
const FAST_MS = 30; // … a shorter one makes it finer
const JUDGED_FRAMES = 4;
const STRIDES = [1, 2, 3, 4, 6, 8, 12, 16];
const NARROW_PX = 760; // below this width the controls lie below the picture
const STEPS = 1000; // of range handles

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
    this.box = bounds(this.surfaces[0]);
    for (const surface of this.surfaces) this.prepare(surface);
    this.ui.showRow.hidden = this.surfaces.length < 2;
    const wanted = Math.sqrt(reason.length / FIRST_POINTS);
    this.stride = STRIDES.find((stride) => stride >= wanted) ?? STRIDES.at(-1);
    this.last = null;
    const flipped = header.kind === "cloud" || header.kind === "points";
    this.view = new View(flipped, this.box, header.stretch, this.surfaces[0].mesh.side);
    this.tools = new Tools(this);
    this.clips = new Clips(this.ui.clips, this.box, header.stretch);
    this.choose("one");
    this.listen();
    this.turnTo(VIEWS.length - 1);
    this.say(header.count ? "Point at the surface to read a value." : "No pixel has a value.");
    if (!header.count) this.list("reason");
    this.colour();
    this.draw();
    performance.mark("fringe-viewer-picture");
    await new Promise((done) => { setTimeout(done); }); // the picture first
    for (const surface of this.surfaces) await surface.addMaps();
    this.list(this.ui.layer.value);
  }

  say(text) {
    this.ui.readout.textContent = text;
  }

  /** Places for the screen, about the first surface's middle, and the layers to colour by. */
  prepare(surface) {
    const { points, header, reason, sigma } = surface;
    const { centre } = this.box;
    const stretch = [1, 1, header.stretch];
    const at = (i) => (points[i] - centre[i % 3]) * stretch[i % 3];
    surface.shown = filled(Float32Array, points.length, at);
    const own = { sigma, plain: new Float32Array(reason.length), reason: new Float32Array(reason) };
    const z = (i) => (reason[i] ? NaN : points[3 * i + 2]);
    own[header.kind] = filled(Float32Array, reason.length, z);
    for (const [name, values] of Object.entries(own)) {
      const unit = name === "sigma" || name === header.kind ? header.unit : "";
      surface.layers.push({ name, values, unit });
    }
    surface.mesh = this.scene.add(surface);
  }

  /** Show one result, both, or their difference. */
  choose(what) {
    const [one, other] = this.surfaces;
    if (what === "difference" && !this.gap) {
      const gap = difference(one, other);
      this.prepare(gap);
      this.gap = gap;
    }
    const sets = { one: [one], other: [other], both: [one, other], difference: [this.gap] };
    this.active = sets[what];
    this.tell();
    this.list(what === "difference" ? "difference" : this.ui.layer.value);
    this.colour();
    this.tools.forget();
    this.resize();
  }

  /** Title, counts and notes: always as text, never as markup. */
  tell() {
    const { ui, active } = this;
    const { notes, note_count: all } = active[0].header;
    const summary = ({ count, raster, stretch, size: [w, h] }) => {
      const parts = [`${count.toLocaleString("en")} ${count === 1 ? "point" : "points"}`];
      if (raster) parts.push(`${percent(count / (w * h))} of ${w} × ${h}`);
      if (stretch !== 1) parts.push(`z drawn × ${stretch.toPrecision(2)}`);
      return parts.join(", ");
    };
    ui.title.textContent = active.map(({ header }) => header.title || "Surface").join(" | ");
    ui.summary.textContent = active.map(({ header }) => summary(header)).join(" | ");
    const shown = all > notes.length ? [...notes, `… and ${all - notes.length} more notes`] : notes;
    ui.notesBox.hidden = !all;
    ui.notesTitle.textContent = `Notes (${all})`;
    ui.notes.replaceChildren(...shown.map((note) => make("li", note)));
  }

  /** Fill the list of layers and choose one. */
  list(wanted) {
    const { layers } = this.active[0];
    const order = Object.keys(LAYERS);
    layers.sort((a, b) => order.indexOf(a.name) - order.indexOf(b.name));
    const options = layers.map(({ name }) => new Option(LAYERS[name].label, name));
    this.ui.layer.replaceChildren(...options);
    this.ui.layer.value = layers.some(({ name }) => name === wanted) ? wanted : layers[0].name;
  }

  colour() {
    const { ui, scene } = this;
    this.layer = this.active[0].layers.find(({ name }) => name === ui.layer.value);
    this.kind = LAYERS[this.layer.name];
    this.mode = this.layer.packed ? 2 : this.kind.mode;
    for (const { layers, mesh } of this.active) {
      const own = layers.find(({ name }) => name === this.layer.name) ?? layers[0];
      scene.setValues(mesh, own.values);
    }
    scene.setScale(this.kind.scale);
    ui.scale.hidden = this.mode !== 1;
    ui.legend.hidden = this.mode !== 3;
    [ui.low.value, ui.high.value] = [0, STEPS];
    this.spread = spread(this.layer.values, this.kind.scale === "signed");
    if (this.mode === 3) this.tellReasons();
    this.rangeChanged();
  }

  /** Ends of the colour scale. */
  get range() {
    const { low, high } = this.spread;
    return [this.ui.low, this.ui.high].map(({ value }) => low + ((high - low) * value) / STEPS);
  }

  rangeChanged() {
    const { ui, kind, layer } = this;
    if (Number(ui.low.value) >= Number(ui.high.value)) ui.low.value = Number(ui.high.value) - 1;
    const digits = decimals((this.spread.high - this.spread.low) / 10);
    const texts = this.range.map((v) => v.toFixed(digits));
    [ui.lowText.textContent, ui.highText.textContent] = texts;
    ui.unitText.textContent = layer.unit ? `${kind.label}, ${layer.unit}` : kind.label;
    for (const [k, input] of [ui.low, ui.high].entries()) {
      input.setAttribute("aria-valuetext", `${texts[k]} ${layer.unit}`);
    }
    this.drawHistogram();
    this.move();
  }

  drawHistogram() {
    const [low, high] = [this.ui.low, this.ui.high].map(({ value }) => value / STEPS);
    if (this.mode === 1) drawHistogram(this.ui.histogram, this.spread.bins, this.kind, low, high);
  }

  /** The legend of the reasons: share, meaning, and what to change. */
  tellReasons() {
    const { header, reason } = this.active[0];
    const counts = header.reasons.map(() => 0);
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

  /** What a picture depends on besides the view. */
  get look() {
    const { ui, kind, mode } = this;
    const colour = (name) => ink(ui.picture, name).split(" ").map((v) => v / 255);
    return {
      mode,
      range: kind.flip ? this.range.toReversed() : this.range,
      low: this.clips.ends("from"),
      high: this.clips.ends("to"),
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
    this.tools.map = null;
    this.rested = false;
    clearTimeout(this.rest);
    this.frame ??= requestAnimationFrame((time) => {
      this.frame = null;
      this.adapt(time);
      this.draw();
      // From here on: a slow frame must not stop the picture of all points that has begun.
      this.rest = setTimeout(() => this.settle(), REST_MS);
    });
  }

  /** Draw all points once the view rests; a pressed button or finger will move it again. */
  settle() {
    if (this.input.holds) return;
    this.last = null;
    const done = () => {
      this.rested = true;
      performance.mark("fringe-viewer-all");
    };
    this.scene.refine(this.meshes, this.view, this.look, this.stride === 1, done);
  }

  /** Keep the time of moving frames between fast and slow, judged by the mean of a few. */
  adapt(time) {
    this.times = this.last === null ? [] : [...this.times, time - this.last];
    this.last = time;
    if (this.times.length < JUDGED_FRAMES) return;
    const mean = this.times.reduce((sum, took) => sum + took, 0) / JUDGED_FRAMES;
    const at = STRIDES.indexOf(this.stride) + (mean > SLOW_MS) - (mean < FAST_MS);
    this.stride = STRIDES[at] ?? this.stride;
    this.times = [];
  }

  draw() {
    this.scene.draw(this.meshes, this.view, this.look, this.stride);
    this.drawOver();
  }

  /** Draw over the surface; `frame` is a rectangle that is being dragged. */
  drawOver(frame = this.tools.frame) {
    const { view, active, cross, tools } = this;
    const names = active.length > 1 ? ["A", "B"] : null;
    const picks = tools.picks.map((i) => active[0].shown.subarray(3 * i, 3 * i + 3));
    const unit = active[0].header.lateral_unit;
    drawOver(this.ui.overlay, { view, active, picks, frame, cross, names, unit });
  }

  resize() {
    this.root.classList.toggle("narrow", this.root.clientWidth < NARROW_PX);
    const { clientWidth, clientHeight } = this.ui.stage;
    this.view.resize(Math.floor(clientWidth / this.active.length), clientHeight);
    this.ui.picture.width = Math.round(clientWidth * this.view.density);
    this.ui.picture.height = Math.round(clientHeight * this.view.density);
    this.drawHistogram();
    this.move();
  }

  turnTo(k) {
    this.view.turnTo(...VIEWS[k]);
    this.view.fit();
    this.move();
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

  /** Add a layer to a surface, in place of one of its name, and offer it. */
  addLayer(surface, layer) {
    surface.layers = surface.layers.filter(({ name }) => name !== layer.name);
    surface.layers.push(layer);
    this.list(this.ui.layer.value);
    if (this.layer.name === layer.name) this.colour();
  }

  listen() {
    const { ui, root } = this;
    this.input = new Input(this);
    root.addEventListener("input", ({ target }) => this.changed(target));
    for (const button of root.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => this.turnTo(Number(button.dataset.view)));
    }
    ui.fit.addEventListener("click", () => this.fitView());
    ui.cross.addEventListener("click", () => this.toggleCross());
    ui.picture.addEventListener("webglcontextlost", () => {
      this.say("The browser has taken the picture's memory away: load the page again.");
    });
    new ResizeObserver(() => this.resize()).observe(ui.stage);
    const scheme = matchMedia("(prefers-color-scheme: dark)");
    scheme.addEventListener("change", () => this.resize());
  }

  changed(target) {
    const { ui, tools } = this;
    if (target === ui.layer) this.colour();
    else if (target === ui.low || target === ui.high) this.rangeChanged();
    else if (target === ui.body) tools.fitBody();
    else if (target.name === "tool") tools.changed();
    else if (target === ui.show) this.tryChoose(target);
    else this.move();
    if (ui.clips.contains(target)) this.clips.tell();
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

  zoom(factor, x = this.view.width / 2, y = this.view.height / 2) {
    this.view.zoom(factor, x, y);
    this.move();
  }

  fitView() {
    this.view.fit();
    this.move();
  }

  toggleCross() {
    const { view } = this;
    this.cross = this.cross ? null : [Math.round(view.width / 2), Math.round(view.height / 2)];
    this.ui.picture.focus();
    this.moveCross(0, 0, 0);
  }

  moveCross(x, y, step) {
    const limits = [this.view.width * this.active.length - 1, this.view.height - 1];
    const moved = (v, k) => Math.min(Math.max(v + step * [x, y][k], 0), limits[k]);
    this.cross &&= this.cross.map(moved);
    this.drawOver();
    if (this.cross) this.tools.inspect(...this.cross);
  }
}

const percent = (share) => `${(100 * share).toFixed(1)} %`;
