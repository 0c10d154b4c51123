// Planes and spheres fitted to a region: the twin of fringeworks.fit_region. LIBRARY holds its
// constants.

import { LIBRARY } from "./assets.js";
import { cross, dot, minus, quantile, times, unit } from "./numbers.js";

// Largest change of a body's values, in sizes of the cloud, after which a fit is done.
const SETTLED = 1e-13;

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
 * Points are relative to their mean, in sizes of the cloud: the equations are well scaled. */
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
    let change = [Infinity];
    for (let k = 0; k < LIBRARY.maxSteps && Math.hypot(...change) > SETTLED; k++) {
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

/** The twin of fringeworks.fit_region for points (n, 3); throws a sentence where it is no fit.
 * `towards` is the side to which a plane's normal points. */
export function fitRegion(points, name, towards) {
  const n = points.length / 3;
  if (n < LIBRARY.minPoints) {
    throw new Error(`A fit needs ${LIBRARY.minPoints} points or more, got ${n}.`);
  }
  const body = BODIES[name];
  const mean = [0, 1, 2].map((k) => points.reduce((sum, v, i) => sum + (i % 3 === k) * v, 0) / n);
  const centred = points.map((v, i) => v - mean[i % 3]);
  const scale = Math.hypot(...[0, 1, 2].map((k) => deviation(centred, k)));
  const scaled = centred.map((v) => v / scale);
  const usual = (sizes, used) => {
    const middle = quantile(sizes.filter((_, i) => !used || used[i]), 0.5);
    return LIBRARY.farSigmas * LIBRARY.madToSigma * middle;
  };
  const first = settle(body, scaled, body.start(scaled, towards), usual);
  const far = 1 - first.used.reduce((sum, flag) => sum + flag, 0) / n;
  if (!(far <= LIBRARY.maxFarShare)) {
    throw new Error(`${(100 * far).toFixed(0)} % of the region lie off the ${name}: choose less.`);
  }
  const kept = n - Math.floor(LIBRARY.discarded * n);
  const found = settle(body, scaled, first.q, (sizes) => sizes.sort()[kept - 1]);
  return figures(body, name, found, { n, kept, mean, scale, towards });
}

/** The figures of a fit in the unit of the points. */
function figures(body, name, { q, used, distances, equations }, { n, kept, mean, scale, towards }) {
  const variance = deviation(distances.filter((_, i) => used[i])) ** 2;
  if (!(Math.sqrt(variance) <= LIBRARY.maxSpread)) {
    throw new Error(`No ${name} fits the region: choose less.`);
  }
  const unitVariance = variances(equations);
  const alike = times(unitVariance, (variance * kept) / LIBRARY.patches);
  if (!(body.loose(q, alike) <= LIBRARY.maxRelativeSigma)) {
    throw new Error(`The region does not determine a ${name}: show more of it.`);
  }
  const ordered = distances.slice().sort();
  const ranges = ordered.subarray(kept - 1).map((v, k) => v - ordered[k]);
  const sign = name === "plane" && dot(q, towards) < 0 ? -1 : 1;
  const result = { name, points: n, deviation: scale * Math.sqrt(variance) };
  result.range = scale * Math.min(...ranges);
  result.distances = distances.map((v) => sign * scale * v);
  if (name === "plane") {
    result.point = mean.map((m, k) => m + scale * q[3] * q[k]);
    return { ...result, normal: times(q.slice(0, 3), sign) };
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

