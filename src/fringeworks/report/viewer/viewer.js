// The viewer: its surfaces, its controls and its picture. The settings are the controls' values.

import { LAYERS, SCALES, TEMPLATE, VIEWS } from "./assets.js";
import { Input } from "./input.js";
import { Areas } from "./lines.js";
import { difference } from "./measure.js";
import { decimals, filled, fixed, make, number, percent } from "./numbers.js";
import { drawPanel } from "./overlay.js";
import { Scale } from "./scale.js";
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
const STEPS = 1000; // of sliders
const CLIP_REACH = 1.02; // of the sliders over half the box: beyond the outermost points
const CLIP_STEP = 0.002; // of a step of the sliders over half the box
const FAR = 1e9; // a plane that clips nothing, beyond every surface
const BAR_PX = 180; // largest length of the scale bar

/** A viewer in an element. Its payloads are those given, or the scripts in the element. */
export class FringeViewer {
  static Areas = Areas; // for pages in which areas are drawn: `viewer.areas` is one
  static numbers = { decimals, fixed, number }; // for the maps of a report

  constructor(element, payloads = null) {
    const own = [...element.querySelectorAll("script[type='application/x-fringeworks-surface']")];
    this.root = Object.assign(make("div"), { className: "fringe-viewer" });
    this.root.innerHTML = TEMPLATE; // a constant of this script, without any data
    element.append(this.root);
    const parts = [...this.root.querySelectorAll("[data-ui]")];
    this.ui = Object.fromEntries(parts.map((part) => [part.dataset.ui, part]));
    this.clips = [...this.ui.clips.querySelectorAll("input")];
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
    this.header = header;
    for (const surface of this.surfaces) this.prepare(surface);
    this.ui.showRow.hidden = this.surfaces.length < 2;
    this.ui.modelRow.hidden = !this.surfaces[0].model;
    const wanted = Math.sqrt(reason.length / FIRST_POINTS);
    this.stride = STRIDES.find((stride) => stride >= wanted) ?? STRIDES.at(-1);
    this.last = null;
    this.view = new View(header);
    this.active = [this.surfaces[0]];
    this.tools = new Tools(this);
    this.scale = new Scale(this);
    this.listen();
    if (!header.count) this.list("reason");
    this.choose("one");
    this.turnTo(VIEWS.length - 1);
    this.say(header.count ? "Point at the surface to read a value." : "No pixel has a value.");
    this.clip();
    this.draw();
    performance.mark("fringe-viewer-picture");
    await new Promise((done) => { setTimeout(done); }); // the picture first
    for (const surface of this.surfaces) await surface.addMaps();
    this.list(header.first ?? this.ui.layer.value);
    if (header.first) this.colour();
  }

  /** Show a newer surface of the same scene in place of the first; the view and the layer stay. */
  async replace(payload) {
    const surface = await unpack(payload);
    await surface.addMaps();
    this.prepare(surface);
    this.scene.remove(this.surfaces[0].mesh);
    this.surfaces[0] = surface;
    this.gap = null;
    this.choose("one");
  }

  /** A pixel is pointed at, here or on a map beside: both show it. */
  point(pixel, told = false) {
    if (pixel === this.pointed) return;
    this.pointed = pixel;
    if (!told) this.onPoint?.(pixel);
    this.tools.cursorAt(pixel);
    this.drawOver();
  }

  say(text) {
    this.ui.readout.textContent = text;
  }

  /** Places for the screen, about the first surface's middle, and the layers to colour by. */
  prepare(surface) {
    const { points, header, reason, sigma, layers } = surface;
    this.lay(surface);
    const z = filled(Float32Array, reason.length, (i) => (reason[i] ? NaN : points[3 * i + 2]));
    const add = (name, values, unit = "") => layers.push({ name, values, unit });
    add(header.kind, z, header.unit);
    add("sigma", sigma, header.unit);
    add("reason", new Float32Array(reason));
    add("plain", new Float32Array(reason.length));
  }

  /** Places for the screen about the first surface's middle, and what the scene draws there. */
  lay(surface) {
    const { box: { centre }, stretch } = this.header;
    const at = (points) => filled(
      Float32Array, points.length,
      (i) => (points[i] - centre[i % 3]) * (i % 3 === 2 ? stretch : 1),
    );
    surface.shown = at(surface.points);
    surface.mesh = this.scene.add(surface);
    if (surface.model) surface.mesh.model = this.scene.addModel(surface.model, at);
  }

  /** Draw the depth larger or smaller than it is. */
  exaggerate(text) {
    const factor = Number(text);
    if (!(factor > 0)) return;
    this.header.stretch *= factor / (this.exaggeration ?? 1);
    this.exaggeration = factor;
    for (const surface of [...this.surfaces, ...(this.gap ? [this.gap] : [])]) {
      this.scene.remove(surface.mesh);
      this.lay(surface);
    }
    const { yaw, pitch } = this.view;
    this.view = Object.assign(new View(this.header), { yaw, pitch });
    this.meshes = this.active.map(({ mesh }) => mesh);
    this.resize();
    this.view.fit();
    this.colour();
    this.clip();
  }

  /** Show one result, both, or their difference. */
  choose(what) {
    const [one, other] = this.surfaces;
    try {
      if (what === "difference" && !this.gap) {
        const gap = difference(one, other);
        this.prepare(gap);
        this.gap = gap;
      }
    } catch (error) {
      this.say(error.message);
      this.ui.show.value = what = "one";
    }
    const sets = { one: [one], other: [other], both: [one, other], difference: [this.gap] };
    this.active = sets[what];
    this.meshes = this.active.map(({ mesh }) => mesh);
    this.tell();
    this.list(what === "difference" ? "difference" : this.ui.layer.value);
    this.tools.forget();
    this.resize();
    this.colour();
  }

  /** Title, counts and notes: always as text, never as markup. */
  tell() {
    const { ui, active } = this;
    const { notes, note_count: count } = active[0].header;
    ui.title.textContent = active.map(({ header }) => header.title || "Surface").join(" | ");
    ui.summary.textContent = active.map(({ header }) => header.summary).join(" | ");
    ui.notesBox.hidden = !count;
    ui.notesTitle.textContent = `Notes (${count})`;
    ui.notes.replaceChildren(...notes.map((note) => make("li", note)));
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
    const named = ({ name }) => name === ui.layer.value;
    this.layer = this.active[0].layers.find(named);
    this.kind = LAYERS[this.layer.name];
    this.mode = this.layer.packed ? 2 : this.kind.mode;
    for (const { layers, mesh } of this.active) {
      scene.setValues(mesh, (layers.find(named) ?? layers[0]).values);
    }
    scene.setScale(this.kind.scale);
    ui.scale.hidden = this.mode !== 1;
    ui.legend.hidden = this.mode !== 3;
    if (this.mode === 3) this.tellReasons();
    this.scale.begin(this.layer, this.kind);
  }

  /** The legend of the reasons: share, meaning, and what to change. */
  tellReasons() {
    const { header, reason } = this.active[0];
    const counts = header.reasons.map(() => 0);
    for (const code of reason) counts[code]++;
    const rows = header.reasons.map(({ label, meaning, advice }, code) => {
      const row = make("li", `${label} ${percent(counts[code] / reason.length)}`);
      const swatch = make("i");
      swatch.style.background = SCALES.reasons[code];
      row.prepend(swatch);
      if (code) row.append(make("small", `${meaning}: ${advice}`));
      return row;
    });
    this.ui.legend.replaceChildren(...rows.filter((_, code) => counts[code]));
  }

  /** What a picture depends on besides the view. */
  get look() {
    const { ui, mode, scale: { range } } = this;
    const style = getComputedStyle(this.root);
    const colour = (name) => style.getPropertyValue(name).split(" ").map((v) => v / 255);
    const uniforms = { mode, range, light: ui.light.checked, hide: ui.hide.checked };
    Object.assign(uniforms, { plain: colour("--plain-rgb"), ...this.clipped });
    const gap = colour("--gap-rgb");
    const gaps = ui.gaps.checked || mode === 3;
    return { uniforms, gap, gaps, model: ui.model.checked, points: ui.points.checked };
  }

  /** Set the clip planes and say where they lie: x, y and z from, then to. */
  clip() {
    const { stretch, box: { centre, half } } = this.header;
    const ends = this.clips.map((input, at) => {
      const [k, free] = [at % 3, at < 3 ? 0 : STEPS];
      const used = Number(input.value) !== free;
      const offset = ((2 * input.value) / STEPS - 1) * CLIP_REACH * half[k];
      const text = used ? number(centre[k] + offset, CLIP_STEP * half[k]) : "–";
      input.previousElementSibling.textContent = text;
      return used ? offset * (k === 2 ? stretch : 1) : FAR * Math.sign(free - 1);
    });
    this.clipped = { low: ends.slice(0, 3), high: ends.slice(3) };
    this.move();
  }

  /** The view or the look has changed: draw coarsely now, and all points after a while. */
  move() {
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
    this.scene.refine(this.meshes, this.view, this.look, this.stride === 1, () => {
      this.rested = !this.frame; // else the view has moved since, and this picture is old
      performance.mark("fringe-viewer-all");
    });
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

  /** Place what lies over the surface; `frame` is a rectangle that is being dragged. */
  drawOver(frame = this.tools.frame) {
    const { ui, view, active, cross } = this;
    const put = (element, x, y) => { element.style.translate = `${x}px ${y}px`; };
    for (const [panel, over] of [...ui.over.children].entries()) {
      over.hidden = panel >= active.length;
      if (!over.hidden) drawPanel(this, over, put);
    }
    ui.frame.hidden = !frame;
    if (frame) {
      const [left, top, right, bottom] = frame;
      put(ui.frame, Math.min(left, right), Math.min(top, bottom));
      ui.frame.style.width = `${Math.abs(right - left)}px`;
      ui.frame.style.height = `${Math.abs(bottom - top)}px`;
    }
    ui.crosshair.hidden = !cross;
    if (cross) put(ui.crosshair, ...cross);
    // 1, 2 or 5 times a power of ten.
    const longest = Math.min(BAR_PX, view.width / 3) / view.scale;
    const power = 10 ** Math.floor(Math.log10(longest));
    const length = power * ([5, 2].find((k) => k * power <= longest) ?? 1);
    ui.bar.style.width = `${length * view.scale}px`;
    ui.bar.textContent = `${Number(length.toPrecision(1))} ${active[0].header.lateral_unit}`;
  }

  resize() {
    const { ui, view, root } = this;
    root.classList.toggle("narrow", root.clientWidth < NARROW_PX);
    root.classList.toggle("both", this.active.length > 1);
    const { clientWidth, clientHeight } = ui.stage;
    if (!clientWidth || !clientHeight) return; // hidden, as in print
    view.resize(Math.floor(clientWidth / this.active.length), clientHeight);
    ui.picture.width = Math.round(clientWidth * view.density);
    ui.picture.height = Math.round(clientHeight * view.density);
    this.move();
  }

  turnTo(k) {
    [this.view.yaw, this.view.pitch] = VIEWS[k];
    this.fitView();
  }

  /** Which pixels are neither clipped nor hidden. */
  shows({ shown, layers }) {
    const { low, high, hide, mode } = this.look.uniforms;
    const values = layers.find(({ name }) => name === this.layer.name)?.values;
    const [from, to] = this.scale.range;
    const hides = hide && mode === 1 && values;
    return (i) => {
      for (let k = 0; k < 3; k++) {
        if (shown[3 * i + k] < low[k] || shown[3 * i + k] > high[k]) return false;
      }
      return !(hides && (values[i] < from || values[i] > to));
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
    ui.curves.addEventListener("pointermove", (event) => this.tools.slide(event));
    ui.panel.addEventListener("submit", (event) => event.preventDefault());
    // The template names the method for each control.
    const call = ({ target, type }) => {
      const control = target.closest("[data-call]");
      const { on = "input", call: name = "move", owner } = control?.dataset ?? {};
      if (on === type) (owner ? this[owner] : this)[name](control?.value);
    };
    for (const type of ["input", "change", "click", "dblclick"]) root.addEventListener(type, call);
    ui.picture.addEventListener("webglcontextlost", () => {
      this.say("The browser has taken the picture's memory away: load the page again.");
    });
    new ResizeObserver(() => this.resize()).observe(ui.stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.move());
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
