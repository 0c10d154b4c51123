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
  const along = (at) => dot(offset, rayAt(surface, at)) / length;
  const sigma = Math.hypot(surface.sigma[i] * along(i), surface.sigma[j] * along(j));
  return { length, offset, sigma };
}

/** Change of a pixel's point with its measured value, whose σ is known: along its ray. */
function rayAt(surface, i) {
  const { header, width } = surface;
  if (header.kind === "cloud") return unit(pointAt(surface, i));
  const { pupil, pitch } = header.place ?? {};
  if (!pupil) return [0, 0, 1];
  const [x, y] = [i % width, Math.floor(i / width)];
  return [((pupil[0] - x) * pitch) / pupil[2], ((y - pupil[1]) * pitch) / pupil[2], 1];
}

/** The twin of profile(…, level=True) in surface/section.py: [along, height, σ], pixels. */
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
    const across = Math.abs(dot(rayAt(surface, at), up)) * surface.sigma[at];
    const sample = [dot(offset, along), dot(offset, up), across];
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
    const ray = a.kind === "cloud" ? unit(p) : [0, 0, 1];
    values[i] = dot(minus(pointAt(other, i), p), ray);
  }
  const sigma = one.sigma.map((s, i) => (reason[i] ? NaN : Math.hypot(s, other.sigma[i])));
  const layers = [{ name: "difference", unit: a.unit, values }];
  const count = reason.reduce((sum, code) => sum + (code === 0), 0);
  const header = { ...a, title: `${b.title || "B"} − ${a.title || "A"}`, count };
  return { ...one, header, reason, sigma, layers };
}

