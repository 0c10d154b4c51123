// Figures of one or two surfaces: distances, profiles and differences.

import { dot, minus, times, unit } from "./numbers.js";

export function pointAt({ points }, i) {
  return [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
}

/** Distance of two pixels' points, with its σ where both points err independently. */
export function distance(surface, i, j) {
  const [p, q] = [pointAt(surface, i), pointAt(surface, j)];
  const offset = minus(q, p);
  const length = Math.hypot(...offset);
  const along = (point) => dot(offset, rayAt(surface, point)) / length;
  const sigma = Math.hypot(surface.sigma[i] * along(p), surface.sigma[j] * along(q));
  return { length, offset, sigma };
}

/** Direction in which a point's σ counts. */
function rayAt({ header }, point) {
  return header.kind === "cloud" ? unit(point) : [0, 0, 1];
}

/** The twin of fringeworks.profile: samples [along, height, σ], and their pixels. */
export function profile(surface, i, j) {
  const { width } = surface;
  const [x, y] = [i % width, Math.floor(i / width)];
  const [dx, dy] = [(j % width) - x, Math.floor(j / width) - y];
  const first = pointAt(surface, i);
  const along = unit(minus(pointAt(surface, j), first));
  const upward = [0, 0, surface.header.kind === "cloud" ? -1 : 1];
  const up = unit(minus(upward, times(along, dot(upward, along))));
  const n = Math.max(Math.abs(dx), Math.abs(dy));
  const samples = [];
  for (let k = 0; k <= n; k++) {
    const at = Math.floor(y + (k / n) * dy + 0.5) * width + Math.floor(x + (k / n) * dx + 0.5);
    const known = surface.reason[at] === 0;
    const offset = minus(pointAt(surface, at), first);
    const sample = [dot(offset, along), dot(offset, up), surface.sigma[at]];
    samples.push({ pixel: at, values: known ? sample : [NaN, NaN, NaN] });
  }
  return samples;
}

/** The twin of fringeworks.difference: a surface with the difference of two as its layer. */
export function difference(one, other) {
  const [a, b] = [one.header, other.header];
  const alike = ["kind", "unit", "lateral_unit"].every((name) => a[name] === b[name]);
  const same = one.width === other.width && one.height === other.height && one.raster;
  if (!alike || !same || !other.raster || a.place?.pitch !== b.place?.pitch) {
    throw new Error("A difference needs two surfaces of one kind, size, pitch and unit.");
  }
  const values = new Float32Array(one.reason.length).fill(NaN);
  const reason = one.reason.map((code, i) => code || other.reason[i]);
  for (let i = 0; i < values.length; i++) {
    if (reason[i]) continue;
    const p = pointAt(one, i);
    values[i] = dot(minus(pointAt(other, i), p), rayAt(one, p));
  }
  const sigma = one.sigma.map((s, i) => (reason[i] ? NaN : Math.hypot(s, other.sigma[i])));
  const layers = [{ name: "difference", unit: a.unit, values }];
  const count = reason.reduce((sum, code) => sum + (code === 0), 0);
  const header = { ...a, title: `${b.title || "B"} − ${a.title || "A"}`, count };
  return { ...one, header, reason, sigma, layers };
}

