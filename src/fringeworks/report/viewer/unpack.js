// From the bytes of a packed surface to points, σ, reasons and layers. pack.py writes the format.

import { LIBRARY } from "./assets.js";
import { filled } from "./numbers.js";

const MAGIC = "FWSURF2\n";
const ARRAYS = { float32: Float32Array, float64: Float64Array }; // other codings are Uint32Array

/** Unpack a surface from base64 text or bytes. Throws an Error with a sentence for the reader.
 * `addMaps` of the surface adds its further layers: the first picture need not wait for them. */
export async function unpack(payload) {
  const { header, body } = split(typeof payload === "string" ? fromBase64(payload) : payload);
  const [width, height] = header.size;
  const count = width * height;
  // A page must not allocate without bound, whatever a damaged header says.
  if (!(count >= 1 && count <= LIBRARY.maxPixels)) {
    throw new Error(`The surface has ${count} pixels; a page shows at most ${LIBRARY.maxPixels}.`);
  }
  const reader = { body, width, height, count };
  const reason = await inflate(reader, header.reason);
  const { first, ratio } = header.sigma;
  const [low] = await decode(reader, header.sigma);
  // Where σ is not known, steps are the finest ones.
  reader.unitSteps = filled(Float64Array, count, (i) => (Number.isNaN(low[i]) ? first : low[i]));
  const sigma = filled(Float32Array, count, (i) => low[i] * Math.sqrt(ratio));
  const points = await readPoints(reader, header, reason);
  const surface = { header, width, height, reason, sigma, points, layers: [] };
  if (header.model) surface.model = await readModel(reader, header.model);
  surface.addMaps = async () => {
    for (const layer of header.layers) surface.layers.push(await readLayer(reader, layer));
  };
  return surface;
}

function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text);
  return filled(Uint8Array, letters.length, (k) => letters.charCodeAt(k));
}

function split(bytes) {
  const start = MAGIC.length + 4;
  if (new TextDecoder().decode(bytes.subarray(0, MAGIC.length)) !== MAGIC) {
    throw new Error("This is not a packed surface, or one of another version.");
  }
  const size = new DataView(bytes.buffer, bytes.byteOffset).getUint32(MAGIC.length, true);
  const text = new TextDecoder().decode(bytes.subarray(start, start + size));
  return { header: JSON.parse(text), body: bytes.subarray(start + size) };
}

async function inflateBlock(body, [offset, packed]) {
  const bytes = body.subarray(offset, offset + packed);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** One byte for each pixel. */
async function inflate({ body, count }, place) {
  const out = await inflateBlock(body, place);
  if (out.length !== count) throw new Error("A block of the surface has not one byte per pixel.");
  return out;
}

/** The mesh of the drawing: corners and triangles. */
async function readModel({ body }, { vertices, faces }) {
  const unpacked = [vertices, faces].map((block) => inflateBlock(body, block));
  const [corners, triangles] = await Promise.all(unpacked);
  return { vertices: new Float32Array(corners.buffer), faces: new Uint32Array(triangles.buffer) };
}

/** One number for each pixel, whose bytes lie in blocks, the lowest first. */
async function readNumbers(reader, blocks, Type) {
  const size = Type.BYTES_PER_ELEMENT;
  const bytes = new Uint8Array(size * reader.count);
  for (const [k, block] of blocks.entries()) {
    const plane = await inflate(reader, block);
    for (let i = 0; i < plane.length; i++) bytes[size * i + k] = plane[i];
  }
  return new Type(bytes.buffer);
}

/** Numbers of every channel of a code, one per pixel; NaN where there is none. Of a logarithm, the
 * lowest value of each code. */
async function decode(reader, code) {
  const Type = ARRAYS[code.coding] ?? Uint32Array;
  const channels = [];
  for (const [k, blocks] of code.blocks.entries()) {
    const numbers = await readNumbers(reader, blocks, Type);
    const values = Type === Uint32Array ? undoPrediction(reader, code, k, numbers) : numbers;
    channels.push(values);
    if (!code.ratio) continue;
    const table = [code.first];
    for (let c = 1; c < 256; c++) table[c] = table[c - 1] * code.ratio;
    for (let i = 0; i < values.length; i++) if (numbers[i]) values[i] = table[values[i]];
  }
  return channels;
}

/** The twin of coding.predicted: every value from its neighbours to the left and above. */
function undoPrediction({ width, count, unitSteps }, code, channel, symbols) {
  const values = new Float64Array(count).fill(NaN);
  const { factor, of_sigma: ofSigma, origins } = code;
  for (let i = 0; i < count; i++) {
    if (symbols[i] === 0) continue;
    const folded = symbols[i] - 1;
    const change = folded % 2 ? -(folded + 1) / 2 : folded / 2;
    const x = i % width;
    const left = x > 0 ? values[i - 1] : NaN;
    const upperLeft = x > 0 && i > width ? values[i - width - 1] : NaN;
    const upperRight = x + 1 < width && i >= width ? values[i - width + 1] : NaN;
    let guess = left + (upperRight - upperLeft) / 2;
    if (Number.isNaN(guess)) guess = left;
    if (Number.isNaN(guess) && i >= width) guess = values[i - width];
    if (Number.isNaN(guess)) guess = origins ? origins[channel] : 0;
    const step = ofSigma ? factor * unitSteps[i] : factor;
    values[i] = (change + Math.floor(guess / step + 0.5)) * step;
  }
  return values;
}

async function readLayer(reader, layer) {
  const [one, green, blue] = await decode(reader, layer);
  const middle = Math.sqrt(layer.ratio ?? 1);
  // Three bytes fit a float exactly; the shader takes them apart.
  const word = (i) => (one[i] + 256 * green[i] + 65536 * blue[i]) / layer.factor;
  const at = blue ? word : (i) => one[i] * middle;
  const values = filled(Float32Array, one.length, at);
  return { name: layer.name, unit: layer.unit, range: layer.range, packed: Boolean(blue), values };
}

/** Coordinates of all pixels, (n, 3); unmeasured ones get a stand-in where the place is known. */
async function readPoints(reader, { points: code, place }, reason) {
  const channels = await decode(reader, code);
  const points = new Float64Array(3 * reader.count).fill(NaN);
  if (place) fillPlaces(reader, place, standIns(channels.at(-1), reader.width), points);
  for (let i = 0; channels.length === 3 && i < points.length; i++) {
    const pixel = (i / 3) | 0;
    if (!reason[pixel]) points[i] = channels[i % 3][pixel];
  }
  return points;
}

/** Give unmeasured pixels their neighbour's depth, so that reasons have a place in the picture. */
function standIns(depth, width) {
  const all = Float64Array.from(depth);
  const n = all.length;
  for (let i = 1; i < n; i++) if (i % width && Number.isNaN(all[i])) all[i] = all[i - 1];
  for (let i = n - 2; i >= 0; i--) if ((i + 1) % width && Number.isNaN(all[i])) all[i] = all[i + 1];
  for (let i = width; i < n; i++) if (Number.isNaN(all[i])) all[i] = all[i - width];
  for (let i = n - width - 1; i >= 0; i--) if (Number.isNaN(all[i])) all[i] = all[i + width];
  return all;
}

/** Points from their z: an offset and z times a direction, polynomials in column and row. */
function fillPlaces({ width, height }, place, z, points) {
  for (let y = 0, i = 0; y < height; y++) {
    const [dx, dy, x0, y0] = inRow(place, y, height);
    for (let x = 0; x < width; x++, i++) {
      const u = (2 * x) / width - 1;
      points[3 * i] = horner(x0, u) + horner(dx, u) * z[i];
      points[3 * i + 1] = horner(y0, u) + horner(dy, u) * z[i];
      points[3 * i + 2] = z[i];
    }
  }
}

/** The polynomials of a row in its columns. */
function inRow({ directions, offsets }, y, height) {
  const v = (2 * y) / height - 1;
  return [...directions, ...offsets].map((powers) => powers.map((own) => horner(own, v)));
}

function horner(polynomial, at) {
  let sum = 0;
  for (let k = polynomial.length - 1; k >= 0; k--) sum = sum * at + polynomial[k];
  return sum;
}

/** Change of a pixel's point with its z. */
export function direction({ header, width, height }, i) {
  if (!header.place) return [0, 0, 1];
  const x = i % width;
  const [dx, dy] = inRow(header.place, (i - x) / width, height);
  return [...[dx, dy].map((row) => horner(row, (2 * x) / width - 1)), 1];
}
