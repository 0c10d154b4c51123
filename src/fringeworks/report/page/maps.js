// The maps of a surface beside each other: value, σ, modulation, reason. All share one zoom and one
// cursor. They take the numbers that the viewer has unpacked.

const SHOWN = ["cloud", "heights", "displacements", "coordinates", "sigma", "modulation", "albedo", "walls", "texture", "deviation", "reason"];
const { decimals, fixed, number } = FringeViewer.numbers;
const MOST_ZOOM = 64;
const ROOM = 0.04; // about what was measured, share of its longer side
const GAP = 0xffb0b0b0; // colour of pixels without a value

/** Values between which most of a map lies; σ and modulation begin at zero. */
function limits(values, name) {
  const finite = values.filter(Number.isFinite).sort();
  if (!finite.length) return [0, 1];
  const at = (share) => finite[Math.min(Math.floor(share * finite.length), finite.length - 1)];
  const low = name === "sigma" || name === "modulation" ? 0 : at(0.002);
  const high = at(name === "sigma" ? 0.98 : 0.998);
  if (name === "deviation") return [-Math.max(-low, high), Math.max(-low, high)];
  return high > low ? [low, high] : [low - 0.5, low + 0.5];
}

/** The box of pixels that holds what was measured, with some room; all where nothing was. */
function measured({ width, height, reason }) {
  let [left, right, top, bottom] = [width, -1, height, -1];
  for (const [i, code] of reason.entries()) {
    if (code) continue;
    const [x, y] = [i % width, Math.floor(i / width)];
    [left, right] = [Math.min(left, x), Math.max(right, x)];
    [top, bottom] = [Math.min(top, y), Math.max(bottom, y)];
  }
  if (right < 0) return { left: 0, top: 0, width, height };
  const room = 1 + Math.floor(ROOM * Math.max(right - left, bottom - top));
  [left, top] = [left - room, top - room].map((v) => Math.max(v, 0));
  right = Math.min(right + room, width - 1);
  bottom = Math.min(bottom + room, height - 1);
  return { left, top, width: right - left + 1, height: bottom - top + 1 };
}

globalThis.FringeMaps = class {
  constructor(element, surface, { LAYERS, SCALES, TABLES }) {
    this.surface = surface;
    this.names = LAYERS;
    this.scales = SCALES;
    this.tables = TABLES;
    this.zoom = 1;
    this.box = measured(surface);
    this.centre = this.middle;
    this.root = document.createElement("div");
    this.root.className = "maps";
    this.told = document.createElement("p");
    this.told.className = "told";
    this.told.setAttribute("role", "status");
    this.told.textContent = "Point at a map or use the arrow keys (Shift: by one pixel) to read its values. Wheel or + and − zoom, drag moves, 0 shows all.";
    this.maps = surface.layers
      .filter(({ name, packed }) => SHOWN.includes(name) && !packed)
      .sort((a, b) => SHOWN.indexOf(a.name) - SHOWN.indexOf(b.name))
      .map((layer) => this.add(layer));
    element.append(this.root, this.told);
    this.draw();
  }

  get middle() {
    const { left, top, width, height } = this.box;
    return [left + width / 2, top + height / 2];
  }

  add(layer) {
    const { label, scale } = this.names[layer.name];
    const reasons = layer.name === "reason";
    const range = reasons ? null : layer.range ?? limits(layer.values, layer.name);
    const figure = document.createElement("figure");
    const canvas = Object.assign(document.createElement("canvas"), { tabIndex: 0 });
    canvas.setAttribute("role", "img");
    const unit = layer.unit ? ` / ${layer.unit}` : "";
    canvas.setAttribute("aria-label", `Map: ${label}${unit}`);
    const caption = document.createElement("figcaption");
    caption.textContent = `${label}${unit}`;
    figure.append(canvas, caption, reasons ? this.legend() : this.bar(range, this.scales[scale]));
    this.root.append(figure);
    this.listen(canvas);
    return { layer, canvas, label, picture: this.paint(layer.values, range, this.tables[scale]) };
  }

  /** The whole map, a canvas pixel for each pixel. */
  paint(values, range, table) {
    const { width, height } = this.surface;
    const picture = new OffscreenCanvas(width, height);
    const context = picture.getContext("2d");
    const image = context.createImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer);
    const [low, high] = range ?? [0, 255]; // reasons are places in their table
    for (let i = 0; i < pixels.length; i++) {
      const place = Math.round(((values[i] - low) * 255) / (high - low));
      pixels[i] = Number.isFinite(place) ? table[Math.min(Math.max(place, 0), 255)] : GAP;
    }
    context.putImageData(image, 0, 0);
    return picture;
  }

  bar([low, high], colours) {
    const bar = document.createElement("div");
    bar.className = "bar";
    bar.style.background = `linear-gradient(to right, ${colours.join(", ")})`;
    const ends = document.createElement("div");
    ends.className = "ends";
    const digits = decimals((high - low) / 10);
    for (const value of [low, (low + high) / 2, high]) {
      ends.append(Object.assign(document.createElement("span"), { textContent: fixed(value, digits) }));
    }
    const whole = document.createElement("div");
    whole.append(bar, ends);
    return whole;
  }

  /** The reasons that occur. */
  legend() {
    const list = document.createElement("ul");
    const present = new Set(this.surface.reason);
    for (const [code, { label }] of this.surface.header.reasons.entries()) {
      if (!present.has(code)) continue;
      const item = Object.assign(document.createElement("li"), { textContent: label });
      const swatch = document.createElement("i");
      swatch.style.background = this.scales.reasons[code];
      item.prepend(swatch);
      list.append(item);
    }
    return list;
  }

  draw() {
    const { width, height } = this.box;
    for (const { canvas, picture } of this.maps) {
      const across = Math.max(canvas.clientWidth, 1);
      canvas.style.aspectRatio = `${width} / ${height}`;
      canvas.width = Math.round(across * devicePixelRatio);
      canvas.height = Math.round((canvas.width * height) / width);
      const scale = (canvas.width / width) * this.zoom;
      const context = canvas.getContext("2d");
      context.imageSmoothingEnabled = scale < 1;
      context.setTransform(scale, 0, 0, scale, canvas.width / 2 - scale * this.centre[0], canvas.height / 2 - scale * this.centre[1]);
      context.drawImage(picture, 0, 0);
      if (this.cursor) {
        context.strokeStyle = "#ffffff";
        context.lineWidth = 2 / scale;
        context.strokeRect(this.cursor[0], this.cursor[1], 1, 1);
        context.strokeStyle = "#000000";
        context.lineWidth = 1 / scale;
        context.strokeRect(this.cursor[0], this.cursor[1], 1, 1);
      }
    }
  }

  /** Column and row at a place of a canvas. */
  place(canvas, x, y) {
    const scale = (canvas.clientWidth / this.box.width) * this.zoom;
    return [
      Math.floor((x - canvas.clientWidth / 2) / scale + this.centre[0]),
      Math.floor((y - canvas.clientHeight / 2) / scale + this.centre[1]),
    ];
  }

  /** The σ that decides the digits of a value: the point's own, for σ itself and what it is of. */
  digitsOf({ name, unit }, i) {
    const own = unit === this.surface.header.unit && name !== "texture";
    return own ? this.surface.sigma[i] : NaN;
  }

  /** A pixel is pointed at in the viewer. */
  point(pixel) {
    const { width } = this.surface;
    if (pixel >= 0) this.tell([pixel % width, Math.floor(pixel / width)], true);
  }

  tell([x, y], told = false) {
    const { width, height, reason, header } = this.surface;
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    this.cursor = [x, y];
    const i = y * width + x;
    if (!told) this.onPoint?.(i);
    const values = this.maps
      .filter(({ layer }) => layer.name !== "reason" && Number.isFinite(layer.values[i]))
      .map(({ layer, label }) => `${label} ${number(layer.values[i], this.digitsOf(layer, i))} ${layer.unit}`);
    const { label, meaning, advice } = header.reasons[reason[i]];
    if (reason[i]) values.push(`no value (${label}): ${meaning}. ${advice}`);
    this.told.textContent = `Column ${x}, row ${y}: ${values.join(", ")}`;
    this.draw();
  }

  /** Move the cursor by keys, and the maps with it where it would leave them. */
  step([dx, dy], pixels) {
    const limit = [this.surface.width - 1, this.surface.height - 1];
    const from = this.cursor ?? this.centre.map(Math.floor);
    this.tell([dx, dy].map((v, k) => Math.min(Math.max(from[k] + pixels * v, 0), limit[k])));
    const half = [this.box.width, this.box.height].map((size) => size / this.zoom / 2);
    const beyond = this.cursor.map((v, k) => Math.abs(v + 0.5 - this.centre[k]) > half[k]);
    if (beyond.some(Boolean)) {
      this.centre = [...this.cursor];
      this.limit();
    }
  }

  move(dx, dy) {
    this.centre = [this.centre[0] + dx, this.centre[1] + dy];
    this.limit();
  }

  scale(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 1), MOST_ZOOM);
    this.limit();
  }

  /** Keep the frame filled. */
  limit() {
    const { left, top, width, height } = this.box;
    for (const [k, [start, size]] of [[left, width], [top, height]].entries()) {
      const half = size / this.zoom / 2;
      this.centre[k] = Math.min(Math.max(this.centre[k], start + half), start + size - half);
    }
    this.draw();
  }

  listen(canvas) {
    const pixel = () => canvas.clientWidth / this.box.width * this.zoom;
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) this.move(-event.movementX / pixel(), -event.movementY / pixel());
      else this.tell(this.place(canvas, event.offsetX, event.offsetY));
    });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("wheel", (event) => {
      // A map in a longer page must not catch the wheel of somebody who scrolls past it.
      if (!this.root.contains(document.activeElement)) return;
      event.preventDefault();
      const before = this.place(canvas, event.offsetX, event.offsetY);
      this.scale(Math.exp(-0.0015 * event.deltaY));
      const after = this.place(canvas, event.offsetX, event.offsetY);
      this.move(before[0] - after[0], before[1] - after[1]);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      if (moves[event.key]) this.step(moves[event.key], event.shiftKey ? 1 : 10);
      else if (event.key === "+" || event.key === "=") this.scale(1.3);
      else if (event.key === "-") this.scale(1 / 1.3);
      else if (event.key === "0") this.scale(0);
      else return;
      event.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }
};
