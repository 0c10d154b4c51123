// From the bytes of a packed surface to points, σ, reasons and layers. pack.py writes the format.

import { LIBRARY } from "./assets.js";
import { filled } from "./numbers.js";

const MAGIC = "FWSURF1\n";
// Newton's method stops at this error, in normalised image coordinates, as rig/pinhole.py does.
const CONVERGED = 1e-11;
const MAX_NEWTON_STEPS = 12;

/** Unpack a surface from base64 text or bytes. Throws an Error with a sentence for the reader.
 * `addMaps` of the surface adds its further layers: the first picture need not wait for them. */
export async function unpack(payload) {
  const bytes = typeof payload === "string" ? fromBase64(payload) : payload;
  const { header, body } = split(bytes);
  const [width, height] = header.size;
  const count = width * height;
  // A page must not allocate without bound, whatever a damaged header says.
  if (!(count >= 1 && count <= LIBRARY.maxPixels)) {
    throw new Error(`The surface has ${count} pixels; a page shows at most ${LIBRARY.maxPixels}.`);
  }
  const reader = { body, width, height };
  const reason = await inflate(reader, header.reason);
  if (reason.length !== count) throw new Error("The reasons do not fit the size of the surface.");
  const measured = filled(Uint8Array, count, (i) => (reason[i] === 0 ? 1 : 0));
  const low = await readLogarithms(reader, header.sigma, measured);
  const half = Math.sqrt(header.sigma.ratio); // to the middle of a code
  const sigma = filled(Float32Array, count, (i) => low[i] * half);
  const points = await readPoints(reader, header, measured, low);
  const { raster } = header;
  const surface = { header, width, height, reason, sigma, points, raster, layers: [] };
  surface.addMaps = async () => {
    for (const layer of header.layers) {
      const used = layer.name === "deviation" ? measured : measured.map(() => 1);
      const values = await readLayer(reader, layer, used, low, header.sigma.first);
      const packed = layer.blocks.length === 3;
      surface.layers.push({ name: layer.name, unit: layer.unit, values, packed });
    }
  };
  return surface;
}

function fromBase64(text) {
  const clean = text.trim();
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(clean);
  const letters = atob(clean);
  const bytes = new Uint8Array(letters.length);
  for (let k = 0; k < letters.length; k++) bytes[k] = letters.charCodeAt(k);
  return bytes;
}

function split(bytes) {
  const start = MAGIC.length + 4;
  if (bytes.length < start || String.fromCharCode(...bytes.subarray(0, 8)) !== MAGIC) {
    throw new Error("This is not a packed surface, or one of another version.");
  }
  const size = new DataView(bytes.buffer, bytes.byteOffset).getUint32(MAGIC.length, true);
  const text = new TextDecoder("utf-8", { fatal: true }).decode(
    bytes.subarray(start, start + size),
  );
  return { header: JSON.parse(text), body: bytes.subarray(start + size) };
}

async function inflate(reader, [offset, packed, size]) {
  const bytes = reader.body.subarray(offset, offset + packed);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const out = new Uint8Array(await new Response(stream).arrayBuffer());
  if (out.length !== size) throw new Error("A block has another size than it says.");
  return out;
}

/** Numbers of every channel of a code, one per pixel; NaN where there is none. `steps` are those of
 * the pixels, or null for whole numbers. */
async function decode(reader, code, used, steps) {
  const channels = [];
  for (const [k, blocks] of code.blocks.entries()) {
    const planes = [];
    for (const block of blocks) planes.push(await inflate(reader, block));
    const origin = code.origins ? code.origins[k] : 0;
    channels.push(undoPrediction(reader, planes, used, steps, origin));
  }
  return channels;
}

/** The twin of coding.predicted: every value from its neighbours to the left and above. */
function undoPrediction({ width, height }, planes, used, steps, origin) {
  const values = new Float64Array(width * height).fill(NaN);
  const symbolAt = (n) => planes.reduce((sum, plane, k) => sum + plane[n] * 256 ** k, 0);
  const [lowest, second] = planes;
  const short = planes.length <= 2;
  for (let y = 0, i = 0, n = 0; y < height; y++) {
    for (let x = 0; x < width; x++, i++) {
      if (!used[i]) continue;
      const symbol = short ? lowest[n] + (second ? second[n] << 8 : 0) : symbolAt(n);
      n++;
      if (symbol === 0) continue;
      const folded = symbol - 1;
      const change = folded % 2 ? -(folded + 1) / 2 : folded / 2;
      const left = x > 0 ? values[i - 1] : NaN;
      const upperLeft = x > 0 && y > 0 ? values[i - width - 1] : NaN;
      const upperRight = x + 1 < width && y > 0 ? values[i - width + 1] : NaN;
      let guess = left + (upperRight - upperLeft) / 2;
      if (Number.isNaN(guess)) guess = left;
      if (Number.isNaN(guess) && y > 0) guess = values[i - width];
      if (Number.isNaN(guess)) guess = origin;
      const step = steps ? steps[i] : 1;
      values[i] = (change + Math.floor(guess / step + 0.5)) * step;
    }
  }
  return values;
}

/** Values of an 8-bit logarithm: the lowest of each code. */
async function readLogarithms(reader, code, used) {
  const table = new Float64Array(256);
  table[0] = code.first;
  for (let k = 1; k < 256; k++) table[k] = table[k - 1] * code.ratio;
  const [codes] = await decode(reader, code, used, null);
  for (let i = 0; i < codes.length; i++) codes[i] = Number.isNaN(codes[i]) ? NaN : table[codes[i]];
  return codes;
}

async function readLayer(reader, layer, used, low, finest) {
  if (layer.coding === "logarithm") {
    const lowest = await readLogarithms(reader, layer, used);
    return filled(Float32Array, lowest.length, (i) => lowest[i] * Math.sqrt(layer.ratio));
  }
  const steps = layer.coding === "steps" ? stepsOf(layer, low, finest) : null;
  const [one, green, blue] = await decode(reader, layer, used, steps);
  if (layer.coding === "steps") return new Float32Array(one);
  if (!green) return filled(Float32Array, one.length, (i) => layer.first + one[i] * layer.step);
  // Three bytes fit a float exactly; the shader takes them apart.
  return filled(Float32Array, one.length, (i) => one[i] + 256 * green[i] + 65536 * blue[i]);
}

/** Step of every pixel: a share of its σ, the finest one where σ is not known. */
function stepsOf(code, low, finest) {
  const own = (i) => code.factor * (Number.isNaN(low[i]) ? finest : low[i]);
  return filled(Float64Array, low.length, code.fixed ? () => code.fixed : own);
}

/** Coordinates of all pixels, (n, 3); unmeasured ones get a stand-in where the place is known. */
async function readPoints(reader, header, measured, low) {
  const { coding, blocks } = header.points;
  const points = new Float64Array(3 * measured.length).fill(NaN);
  let z;
  if (coding.startsWith("float")) {
    for (let k = 0; k < 3; k++) {
      const values = await readFloats(reader, blocks[k], coding);
      for (let i = 0, n = 0; i < measured.length; i++)
        if (measured[i]) points[3 * i + k] = values[n++];
    }
  } else {
    const steps = stepsOf(header.points, low, header.sigma.first);
    const found = await decode(reader, header.points, measured, steps);
    if (coding === "z") z = found[0];
    else for (let i = 0; i < points.length; i++) points[i] = found[i % 3][(i / 3) | 0];
  }
  if (!header.place) return points;
  const depth = z ?? filled(Float64Array, measured.length, (i) => points[3 * i + 2]);
  const all = standIns(depth, reader.width);
  const place = header.place.kind === "camera" ? alongRays : overPlane;
  place(header.place, reader, all, points, z ? null : measured);
  return points;
}

async function readFloats(reader, blocks, coding) {
  const planes = [];
  for (const block of blocks) planes.push(await inflate(reader, block));
  const itemSize = coding === "float64" ? 8 : 4;
  const bytes = new Uint8Array(itemSize * planes[0].length);
  for (const [k, plane] of planes.entries()) {
    for (let n = 0; n < plane.length; n++) bytes[itemSize * n + k] = plane[n];
  }
  return coding === "float64" ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
}

/** Give unmeasured pixels their neighbour's depth, so that reasons have a place in the picture. */
function standIns(depth, width) {
  const all = depth.slice();
  const n = all.length;
  for (let i = 1; i < n; i++) if (i % width && Number.isNaN(all[i])) all[i] = all[i - 1];
  for (let i = n - 2; i >= 0; i--) if ((i + 1) % width && Number.isNaN(all[i])) all[i] = all[i + 1];
  for (let i = width; i < n; i++) if (Number.isNaN(all[i])) all[i] = all[i - width];
  for (let i = n - width - 1; i >= 0; i--) if (Number.isNaN(all[i])) all[i] = all[i + width];
  return all;
}

function overPlane({ pitch, pupil }, { width }, z, points, keep) {
  for (let i = 0; i < z.length; i++) {
    if (keep?.[i]) continue;
    let x = i % width;
    let y = (i - x) / width;
    if (pupil) {
      // The twin of plane_lattice: offset plus slope times z, in this order.
      const slopeX = -(x - pupil[0]) / pupil[2];
      const slopeY = -(y - pupil[1]) / pupil[2];
      x += slopeX * z[i];
      y += slopeY * z[i];
    }
    points[3 * i] = x * pitch;
    points[3 * i + 1] = -y * pitch;
    points[3 * i + 2] = z[i];
  }
}

function alongRays({ camera, every }, { width, height }, z, points, keep) {
  const [fx, fy, cx, cy, ...distortion] = camera;
  const lens = new Lens(distortion);
  for (let y = 0, i = 0; y < height; y++) {
    lens.restart();
    for (let x = 0; x < width; x++, i++) {
      lens.undistort((every * x - cx) / fx, (every * y - cy) / fy);
      if (keep?.[i]) continue;
      points[3 * i] = lens.x * z[i];
      points[3 * i + 1] = lens.y * z[i];
      points[3 * i + 2] = z[i];
    }
  }
}

/** Brown's lens distortion, undone by Newton's method as in rig/pinhole.py. */
class Lens {
  constructor(distortion) {
    this.distortion = distortion;
    this.none = distortion.every((k) => k === 0);
    this.restart();
  }

  /** Forget the last pixel: the next one starts from its distorted place. */
  restart() {
    this.x = NaN;
    this.seenX = 0;
    this.seenY = 0;
  }

  /** Set x and y to the undistorted place of a pixel; the last one's solution is the start. */
  undistort(seenX, seenY) {
    const follow = !this.none && !Number.isNaN(this.x);
    this.x = follow ? this.x + seenX - this.seenX : seenX;
    this.y = follow ? this.y + seenY - this.seenY : seenY;
    this.seenX = seenX;
    this.seenY = seenY;
    if (this.none) return;
    const [k1, k2, p1, p2, k3] = this.distortion;
    for (let step = 0; step < MAX_NEWTON_STEPS; step++) {
      const { x, y } = this;
      const r2 = x * x + y * y;
      const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
      const errorX = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - seenX;
      const errorY = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - seenY;
      if (Math.abs(errorX) < CONVERGED && Math.abs(errorY) < CONVERGED) return;
      const slope = 2 * (k1 + r2 * (2 * k2 + 3 * k3 * r2));
      const a = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x;
      const b = x * y * slope + 2 * p1 * x + 2 * p2 * y;
      const c = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x;
      const determinant = a * c - b * b;
      this.x -= (c * errorX - b * errorY) / determinant;
      this.y -= (a * errorY - b * errorX) / determinant;
    }
    this.x = this.y = NaN;
  }
}
