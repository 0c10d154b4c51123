// Figures of one or two surfaces: distances, profiles and differences, as the library has them.

import { dot, minus, times, unit } from "./numbers.js";
import { direction } from "./unpack.js";

export const pointAt = ({ points: p }, i) => [p[3 * i], p[3 * i + 1], p[3 * i + 2]];

/** Change of a pixel's point with its measured value, whose σ is known. */
function rayAt(surface, i) {
  return surface.header.kind === "cloud" ? unit(pointAt(surface, i)) : direction(surface, i);
}

/** Distance of two pixels' points, with its σ where both points err independently. */
export function distance(surface, i, j) {
  const offset = minus(pointAt(surface, j), pointAt(surface, i));
  const length = Math.hypot(...offset);
  const err = (at) => (surface.sigma[at] * dot(offset, rayAt(surface, at))) / length;
  return { length, offset, sigma: Math.hypot(err(i), err(j)) };
}

/** The pixels from one to another, both included. */
export function between({ width }, i, j) {
  const [x, y] = [i % width, Math.floor(i / width)];
  const [dx, dy] = [(j % width) - x, Math.floor(j / width) - y];
  const n = Math.max(Math.abs(dx), Math.abs(dy));
  return Array.from({ length: n + 1 }, (_, k) => {
    const share = n && k / n;
    return Math.floor(y + share * dy + 0.5) * width + Math.floor(x + share * dx + 0.5);
  });
}

/** The twin of profile(…, level=True): [along, height, σ] of the pixels between two. */
export function profile(surface, i, j) {
  const { header, reason, sigma } = surface;
  const first = pointAt(surface, i);
  const along = unit(minus(pointAt(surface, j), first));
  const upward = [0, 0, header.away ? -1 : 1];
  const up = unit(minus(upward, times(along, dot(upward, along))));
  return between(surface, i, j).map((at) => {
    if (reason[at]) return [NaN, NaN, NaN];
    const offset = minus(pointAt(surface, at), first);
    return [dot(offset, along), dot(offset, up), Math.abs(dot(rayAt(surface, at), up)) * sigma[at]];
  });
}

/** The twin of fringeworks.difference: a surface with the difference of two as its layer. */
export function difference(one, other) {
  const frame = ({ header: { kind, size, unit: own, lateral_unit, place, placed } }) =>
    JSON.stringify([kind, size, own, lateral_unit, place?.offsets, placed]);
  if (!one.header.raster || !other.header.raster || frame(one) !== frame(other)) {
    const alike = "two surfaces of one kind, size, pitch and unit in one place";
    throw new Error(`A difference needs ${alike}.`);
  }
  const [a, b] = [one.header, other.header];
  const values = new Float32Array(one.reason.length).fill(NaN);
  const sigma = values.slice();
  const reason = one.reason.map((code, i) => code || other.reason[i]);
  let count = 0;
  for (let i = 0; i < values.length; i++) {
    if (reason[i]) continue;
    count++;
    const p = pointAt(one, i);
    values[i] = dot(minus(pointAt(other, i), p), a.kind === "cloud" ? unit(p) : [0, 0, 1]);
    sigma[i] = Math.hypot(one.sigma[i], other.sigma[i]);
  }
  const title = `${b.title || "B"} − ${a.title || "A"}`;
  const summary = `${count.toLocaleString("en")} points in both`;
  const layers = [{ name: "difference", unit: a.unit, values }];
  return { ...one, header: { ...a, title, summary, count }, reason, sigma, layers };
}
