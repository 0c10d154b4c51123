// Figures from points: triangles, normals, picks, profiles, fitted bodies, differences. Each is the
// twin of a function of the library, which the comments name; the tests compare the two. LIBRARY
// holds the constants of those functions.

import { LIBRARY } from "./assets.js";

// Pixels to either side between which a normal's slopes are taken: noise is averaged over 5 × 5.
const NORMAL_REACH = 2;
// Triangles, about, whose sides give the usual one; values, about, that quantiles come from.
const SAMPLED = 5000;
const SAMPLED_VALUES = 100_000;
const BINS = 120;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a, k) => a.map((v) => v * k);
const unit = (a) => times(a, 1 / Math.hypot(...a));
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

export function pointAt({ points }, i) {
  return [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
}

/** The sides that are too long for a surface: cut(i, j, k) tells whether a triangle is left out. */
export function edgeRule(surface) {
  const { points, width, height, reason, header } = surface;
  if (header.kind !== "cloud") {
    const steepest = (LIBRARY.maxSlope * header.place.pitch) / header.stretch;
    const rise = (i, j) => Math.abs(points[3 * i + 2] - points[3 * j + 2]);
    return {
      side: header.place.pitch,
      apart: (i, j, pixels) => rise(i, j) > steepest * pixels,
      cut: (i, j, k, pixels) => Math.max(rise(i, j), rise(j, k), rise(k, i)) > steepest * pixels,
    };
  }
  const longest = (i, j, k) =>
    Math.sqrt(Math.max(square(points, i, j), square(points, j, k), square(points, k, i))) /
    points[3 * i + 2];
  const sides = [];
  const every = Math.max(1, Math.floor((width * height) / SAMPLED));
  for (let i = 0; i < width * (height - 1); i += every) {
    const whole = i % width < width - 1 && !reason[i] && !reason[i + 1] && !reason[i + width];
    if (whole) sides.push(longest(i, i + width, i + 1));
  }
  const usual = quantile(Float64Array.from(sides), 0.5);
  const limit = LIBRARY.longSide * usual;
  return {
    side: (usual || 1e-3) * (bounds(surface).centre[2] || 1),
    apart: (i, j, pixels) => square(points, i, j) > (limit * pixels * points[3 * i + 2]) ** 2,
    cut: (i, j, k, pixels) =>
      !(longest(i, j, k) < limit * pixels) || grazes(points, 3 * i, 3 * j, 3 * k),
  };
}

function square(p, i, j) {
  const x = p[3 * i] - p[3 * j];
  const y = p[3 * i + 1] - p[3 * j + 1];
  const z = p[3 * i + 2] - p[3 * j + 2];
  return x * x + y * y + z * z;
}

/** Whether a triangle is seen at less than 5°. */
function grazes(p, i, j, k) {
  const [ax, ay, az] = [p[j] - p[i], p[j + 1] - p[i + 1], p[j + 2] - p[i + 2]];
  const [bx, by, bz] = [p[k] - p[i], p[k + 1] - p[i + 1], p[k + 2] - p[i + 2]];
  const [x, y, z] = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
  const seen = x * p[i] + y * p[i + 1] + z * p[i + 2];
  const size = (x * x + y * y + z * z) * (p[i] ** 2 + p[i + 1] ** 2 + p[i + 2] ** 2);
  return seen * seen < LIBRARY.grazingCosine ** 2 * size;
}

/** Triangles of every k-th pixel, as cloud_triangles and height_map_triangles; and of gaps. */
export function triangles(surface, rule, stride) {
  const { points, width, height, reason } = surface;
  const cells = Math.floor((width - 1) / stride) * Math.floor((height - 1) / stride);
  const faces = new Uint32Array(6 * Math.max(cells, 0));
  const gaps = [];
  let used = 0;
  const add = (i, j, k) => {
    if (reason[i] || reason[j] || reason[k]) {
      if (!Number.isNaN(points[3 * i] + points[3 * j] + points[3 * k])) gaps.push(i, j, k);
    } else if (!rule.cut(i, j, k, stride)) {
      faces[used++] = i;
      faces[used++] = j;
      faces[used++] = k;
    }
  };
  for (let y = 0; y + stride < height; y += stride) {
    for (let x = 0; x + stride < width; x += stride) {
      const a = y * width + x;
      const c = a + stride * width;
      add(a, c, a + stride);
      add(a + stride, c, c + stride);
    }
  }
  return { faces: faces.subarray(0, used), gaps: Uint32Array.from(gaps) };
}

/** Write unit normals of every k-th pixel, towards the camera, as bytes; 0 where unknown. */
export function fillNormals(surface, rule, stride, out) {
  const { shown, width, height, reason } = surface;
  const sum = new Float64Array(6);
  const addSlope = (at, m, step, place, size) => {
    let from = place >= NORMAL_REACH ? m - NORMAL_REACH * step : m;
    let to = place + NORMAL_REACH < size ? m + NORMAL_REACH * step : m;
    if (reason[from] || rule.apart(from, m, NORMAL_REACH)) from = m;
    if (reason[to] || rule.apart(to, m, NORMAL_REACH)) to = m;
    for (let k = 0; k < 3; k++) sum[at + k] += shown[3 * to + k] - shown[3 * from + k];
  };
  for (let y = 0; y < height; y += stride) {
    for (let x = 0; x < width; x += stride) {
      const i = y * width + x;
      if (reason[i]) continue;
      sum.fill(0);
      for (let t = -NORMAL_REACH; t <= NORMAL_REACH; t++) {
        const above = i + t * width;
        if (y + t >= 0 && y + t < height && !reason[above]) addSlope(0, above, 1, x, width);
        if (x + t >= 0 && x + t < width && !reason[i + t]) addSlope(3, i + t, width, y, height);
      }
      const [ax, ay, az, bx, by, bz] = sum;
      const n = [by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax];
      const size = Math.hypot(...n) || Infinity;
      for (let k = 0; k < 3; k++) out[4 * i + k] = Math.round((127 * n[k]) / size);
    }
  }
}

/** For every place on the screen the pixel of the surface that is in front, −1 for none. */
export function pickMap(surface, view, shows) {
  const { shown, reason } = surface;
  const { width, height, toScreen } = view;
  const maps = [new Int32Array(width * height).fill(-1), new Int32Array(width * height).fill(-1)];
  const depths = maps.map((map) => new Float32Array(map.length).fill(-Infinity));
  const [xx, xy, xz, x0, yx, yy, yz, y0, zx, zy, zz] = toScreen;
  for (let i = 0; i < reason.length; i++) {
    const [x, y, z] = [shown[3 * i], shown[3 * i + 1], shown[3 * i + 2]];
    const column = Math.floor(xx * x + xy * y + xz * z + x0);
    const row = Math.floor(yx * x + yy * y + yz * z + y0);
    if (!(column >= 0 && row >= 0 && column < width && row < height) || !shows(i)) continue;
    const at = row * width + column;
    const layer = reason[i] ? 1 : 0;
    const depth = zx * x + zy * y + zz * z;
    if (depth > depths[layer][at]) {
      depths[layer][at] = depth;
      maps[layer][at] = i;
    }
  }
  return { width, height, measured: maps[0], unmeasured: maps[1] };
}

/** The pixel nearest to a place on the screen; one without a value where no other is near. */
export function pick(map, x, y, reach) {
  const found = nearest(map, map.measured, x, y, reach);
  return found >= 0 ? found : nearest(map, map.unmeasured, x, y, reach);
}

function nearest({ width, height }, map, x, y, reach) {
  let best = reach * reach + 1;
  let found = -1;
  for (let row = Math.max(0, y - reach); row <= Math.min(height - 1, y + reach); row++) {
    for (let column = Math.max(0, x - reach); column <= Math.min(width - 1, x + reach); column++) {
      const distance = (row - y) ** 2 + (column - x) ** 2;
      if (map[row * width + column] >= 0 && distance < best) {
        best = distance;
        found = map[row * width + column];
      }
    }
  }
  return found;
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

/** Sums over the used points of the products of a row of numbers, and of the row with a value. */
function normalEquations(points, used, row, value) {
  const sums = [];
  for (let i = 0; i < points.length; i += 3) {
    if (used && !used[i / 3]) continue;
    const r = [...row(points[i], points[i + 1], points[i + 2]), 0];
    r[r.length - 1] = value(points[i], points[i + 1], points[i + 2]);
    for (let k = 0; k < r.length - 1; k++) {
      sums[k] ??= new Float64Array(r.length);
      for (let m = 0; m < r.length; m++) sums[k][m] += r[k] * r[m];
    }
  }
  return sums;
}

/** Solve linear equations, each a row with its right side, by elimination with pivots. */
function solve(equations) {
  const rows = equations.map((row) => Float64Array.from(row));
  const n = rows.length;
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let m = k; m < n; m++) if (Math.abs(rows[m][k]) > Math.abs(rows[pivot][k])) pivot = m;
    [rows[k], rows[pivot]] = [rows[pivot], rows[k]];
    for (let m = 0; m < n; m++) {
      const factor = m === k ? 0 : rows[m][k] / rows[k][k];
      for (let c = k; c <= n; c++) rows[m][c] -= factor * rows[k][c];
    }
  }
  return rows.map((row, k) => row[n] / row[k]);
}

/** Diagonal of the inverse of normal equations: variances where points err by 1. */
function variances(equations) {
  const column = (k) => equations.map((row, m) => [...row.slice(0, -1), m === k ? 1 : 0]);
  return equations.map((_, k) => solve(column(k))[k]);
}

/** Bodies: a start, one step of orthogonal least squares, distances, and what is not determined.
 * Points are relative to their mean, in sizes of the cloud, which keeps the equations well scaled. */
const BODIES = {
  plane: {
    start: (_, towards) => [...towards, 0],
    distance: (q, x, y, z) => q[0] * x + q[1] * y + q[2] * z - q[3],
    slopes: (q) => {
      const [s, t] = tangents(q);
      return (x, y, z) => [dot(s, [x, y, z]), dot(t, [x, y, z]), -1];
    },
    moved: (q, [a, b, offset]) => {
      const [s, t] = tangents(q);
      const n = [0, 1, 2].map((k) => q[k] + a * s[k] + b * t[k]);
      return times([...n, q[3] + offset], 1 / Math.hypot(...n));
    },
    loose: (_, variance) => Math.sqrt(variance[0] + variance[1]),
  },
  sphere: {
    // Linear in the centre and in r² − c².
    start: (points) => {
      const row = (x, y, z) => [2 * x, 2 * y, 2 * z, 1];
      const c = solve(normalEquations(points, null, row, (x, y, z) => x * x + y * y + z * z));
      return [c[0], c[1], c[2], Math.sqrt(c[3] + dot(c, c))];
    },
    distance: (q, x, y, z) => Math.hypot(x - q[0], y - q[1], z - q[2]) - q[3],
    slopes: (q) => (x, y, z) => [...unit(minus(q, [x, y, z])), -1],
    moved: (q, step) => q.map((v, k) => v + step[k]),
    loose: (q, variance) => Math.sqrt(variance[3]) / Math.abs(q[3]),
  },
};

function tangents(n) {
  const s = unit(cross(n, Math.abs(n[0]) < 0.6 ? [1, 0, 0] : [0, 1, 0]));
  return [s, cross(n, s)];
}

/** Least squares of the distances of the points that `choose` keeps, chosen anew each round. */
function settle(body, points, start, choose) {
  const found = { q: start, used: null };
  for (let round = 0; round < LIBRARY.fitRounds; round++) {
    for (let step = 0, change = [1]; step < LIBRARY.maxSteps && Math.hypot(...change) > 1e-13; step++) {
      const left = (x, y, z) => -body.distance(found.q, x, y, z);
      found.equations = normalEquations(points, found.used, body.slopes(found.q), left);
      change = solve(found.equations);
      found.q = body.moved(found.q, change);
    }
    const at = (i) => body.distance(found.q, points[i], points[i + 1], points[i + 2]);
    found.distances = Float64Array.from({ length: points.length / 3 }, (_, i) => at(3 * i));
    const before = found.used;
    const limit = choose(found.distances.map(Math.abs), before);
    found.used = found.distances.map((v) => Math.abs(v) <= limit);
    if (before?.every((flag, i) => flag === found.used[i])) break;
  }
  return found;
}

/** The twin of fringeworks.fit_region for points (n, 3); throws a sentence where it is no fit. */
export function fitRegion(points, name, towards) {
  const n = points.length / 3;
  if (n < LIBRARY.minPoints) throw new Error(`A fit needs ${LIBRARY.minPoints} points or more, got ${n}.`);
  const body = BODIES[name];
  const mean = [0, 1, 2].map((k) => points.reduce((sum, v, i) => sum + (i % 3 === k) * v, 0) / n);
  const centred = points.map((v, i) => v - mean[i % 3]);
  const scale = Math.hypot(...[0, 1, 2].map((k) => deviation(centred, k)));
  const scaled = centred.map((v) => v / scale);
  const usual = (sizes, used) =>
    LIBRARY.farSigmas *
    LIBRARY.madToSigma *
    quantile(
      sizes.filter((_, i) => !used || used[i]),
      0.5,
    );
  const first = settle(body, scaled, body.start(scaled, towards), usual);
  const far = 1 - first.used.reduce((sum, flag) => sum + flag, 0) / n;
  if (!(far <= LIBRARY.maxFarShare)) {
    throw new Error(`${(100 * far).toFixed(0)} % of the region lie off the ${name}: choose less.`);
  }
  const kept = n - Math.floor(LIBRARY.discarded * n);
  const last = settle(body, scaled, first.q, (sizes) => sizes.sort()[kept - 1]);
  const { q, distances } = last;
  const ordered = distances.slice().sort();
  const variance = deviation(distances.filter((_, i) => last.used[i])) ** 2;
  const unitVariance = variances(last.equations);
  if (!(body.loose(q, times(unitVariance, (variance * kept) / LIBRARY.patches)) <= LIBRARY.maxRelativeSigma)) {
    throw new Error(`The region does not determine a ${name}: show more of it.`);
  }
  const ranges = distances.subarray(kept - 1).map((_, k) => ordered[k + kept - 1] - ordered[k]);
  const sign = name === "plane" && dot(q, towards) < 0 ? -1 : 1;
  const result = { name, points: n, deviation: scale * Math.sqrt(variance) };
  result.range = scale * Math.min(...ranges);
  result.distances = distances.map((v) => sign * scale * v);
  if (name === "plane") {
    const point = mean.map((m, k) => m + scale * q[3] * q[k]);
    return { ...result, point, normal: times(q.slice(0, 3), sign) };
  }
  const radiusSigma = scale * Math.sqrt(unitVariance[3] * variance);
  const centre = mean.map((m, k) => m + scale * q[k]);
  return { ...result, centre, radius: scale * q[3], radiusSigma };
}

/** Standard deviation of every third number, or of all. */
function deviation(values, k) {
  const own = k === undefined ? values : values.filter((_, i) => i % 3 === k);
  const mean = own.reduce((sum, v) => sum + v, 0) / own.length;
  return Math.sqrt(own.reduce((sum, v) => sum + (v - mean) ** 2, 0) / own.length);
}

/** A quantile of numbers, which are sorted in place; NaN counts as nothing. */
export function quantile(values, share) {
  const known = values.filter((v) => !Number.isNaN(v)).sort();
  if (!known.length) return NaN;
  const place = share * (known.length - 1);
  const low = Math.floor(place);
  const high = Math.min(low + 1, known.length - 1);
  return known[low] + (place - low) * (known[high] - known[low]);
}

const sampled = (values) => {
  const every = Math.max(1, Math.floor(values.length / SAMPLED_VALUES));
  return values.filter((_, i) => i % every === 0);
};

/** The box that holds nearly all measured points: its middle and half its sides. */
export function bounds({ points, reason }) {
  const ends = [0.002, 0.998].map((share) =>
    [0, 1, 2].map((k) => {
      const own = Float64Array.from(reason, (code, i) => (code ? NaN : points[3 * i + k]));
      return quantile(sampled(own), share);
    }),
  );
  const centre = [0, 1, 2].map((k) => (ends[0][k] + ends[1][k]) / 2 || 0);
  return { centre, half: [0, 1, 2].map((k) => (ends[1][k] - ends[0][k]) / 2 || 0.5) };
}

/** Rough distance of neighbours in a list of points: they cover their box once. */
export function usualDistance(surface) {
  const { half } = bounds(surface);
  return 2 * Math.sqrt((half[0] * half[1]) / Math.max(surface.header.count, 1));
}

/** The range of nearly all values, about 0 for signed ones; and how many lie in each bin of it. */
export function spread(values, signed) {
  const some = sampled(values);
  let [low, high] = [quantile(some, 0.002), quantile(some, 0.998)];
  if (Number.isNaN(low)) [low, high] = [0, 1];
  if (signed) [low, high] = [-1, 1].map((side) => side * Math.max(-low, high));
  if (!(high > low)) [low, high] = [low - 0.5, low + 0.5];
  const bins = new Array(BINS).fill(0);
  for (const v of some) if (v >= low && v < high) bins[Math.floor((BINS * (v - low)) / (high - low))]++;
  return { low, high, bins };
}
