// Planes and spheres fitted to a region: the twin of fringeworks.fit_region. LIBRARY holds its
// constants.

import { LIBRARY } from "./assets.js";
import { dot, minus, quantile, times, unit } from "./numbers.js";

// Largest change of a body's values, in sizes of the cloud, after which a fit is done.
const SETTLED = 1e-13;
// Radius in sizes of the cloud above which rounding hides the curvature from normal equations.
const FLAT = 3000;

/** Linear least squares over the used points, of which `equation` gives slopes and a value. Of many
 * points every k-th one suffices: calibration limits the precision, not their number. */
function leastSquares(points, used, equation) {
  const sums = [];
  const every = Math.ceil(points.length / LIBRARY.refinedPoints);
  for (let i = 0; i < points.length; i += every) {
    if (used && !used[i]) continue;
    const row = equation(points[i]);
    for (let k = 0; k < row.length - 1; k++) {
      sums[k] ??= row.map(() => 0);
      for (let m = 0; m < row.length; m++) sums[k][m] += row[k] * row[m];
    }
  }
  // Elimination; the identity on the right becomes the inverse, whose diagonal are variances.
  const rows = sums.map((row, k) => row.concat(sums.map((_, m) => Number(m === k))));
  for (const k of rows.keys()) {
    rows[k] = times(rows[k], 1 / rows[k][k]);
    const cleared = (row) => row.map((v, c) => v - row[k] * rows[k][c]);
    for (const m of rows.keys()) if (m !== k) rows[m] = cleared(rows[m]);
  }
  const n = rows.length;
  return { solution: rows.map((row) => row[n]), variances: rows.map((row, k) => row[n + 1 + k]) };
}

/** Two directions in a plane. */
function tangents([x, y, z]) {
  const s = unit(Math.abs(x) < 0.6 ? [0, z, -y] : [-z, 0, x]);
  return [s, [y * s[2] - z * s[1], z * s[0] - x * s[2], x * s[1] - y * s[0]]];
}

/** Bodies: a start, the distance of a point, its slopes and what is left of it, the body a step
 * away, and how little of it is determined. Points are about their mean, in sizes of the cloud. */
const BODIES = {
  plane: {
    start: (_, towards) => [...towards, 0],
    distance: (q, p) => dot(q, p) - q[3],
    equation: (q) => {
      const [s, t] = tangents(q);
      return (p) => [dot(s, p), dot(t, p), -1, q[3] - dot(q, p)];
    },
    moved: (q, [a, b, offset]) => {
      const [s, t] = tangents(q);
      const n = s.map((_, k) => q[k] + a * s[k] + b * t[k]);
      return times([...n, q[3] + offset], 1 / Math.hypot(...n));
    },
    loose: (_, [a, b]) => Math.sqrt(a + b),
  },
  sphere: {
    // Linear in the centre c and in r² − c².
    start: (points) => {
      const equation = (p) => [...times(p, 2), 1, dot(p, p)];
      const [x, y, z, rest] = leastSquares(points, null, equation).solution;
      return [x, y, z, Math.sqrt(rest + x * x + y * y + z * z)];
    },
    distance: (q, p) => Math.sqrt(dot(minus(p, q), minus(p, q))) - q[3],
    equation: (q) => (p) => {
      const [x, y, z] = minus(q, p);
      const size = Math.sqrt(x * x + y * y + z * z);
      return [x / size, y / size, z / size, -1, q[3] - size];
    },
    moved: (q, step) => q.map((v, k) => v + step[k]),
    loose: (q, variances) => Math.sqrt(variances[3]) / Math.abs(q[3]),
  },
};

/** Least squares of the distances of the points that `limit` keeps, chosen anew each round. */
function settle(body, points, start, limit) {
  let [q, used, distances, variances] = [start, null, null, null];
  for (let round = 0; round < LIBRARY.fitRounds; round++) {
    let change = [Infinity];
    for (let k = 0; k < LIBRARY.maxSteps && Math.hypot(...change) > SETTLED; k++) {
      ({ solution: change, variances } = leastSquares(points, used, body.equation(q)));
      q = body.moved(q, change);
    }
    distances = Float64Array.from(points, (p) => body.distance(q, p));
    const sizes = distances.map(Math.abs);
    const most = limit(sizes, used);
    const before = used;
    used = sizes.map((size) => size <= most);
    if (before?.every((flag, i) => flag === used[i])) break;
  }
  return { q, used, distances, variances };
}

/** The twin of fringeworks.fit_region for points (n, 3); throws a sentence where it is no fit.
 * `towards` is the side to which a plane's normal points. */
export function fitRegion(given, name, towards) {
  const n = given.length;
  if (n < LIBRARY.minPoints) {
    throw new Error(`A fit needs ${LIBRARY.minPoints} points or more, got ${n}.`);
  }
  const body = BODIES[name];
  const mean = [0, 1, 2].map((k) => given.reduce((sum, p) => sum + p[k], 0) / n);
  const centred = given.map((p) => minus(p, mean));
  const scale = Math.sqrt(centred.reduce((sum, p) => sum + dot(p, p), 0) / n);
  const points = centred.map((p) => times(p, 1 / scale));
  const { farSigmas, madToSigma } = LIBRARY;
  const usual = (sizes, used) =>
    farSigmas * madToSigma * quantile(sizes.filter((_, i) => !used || used[i]), 0.5);
  const first = settle(body, points, body.start(points, towards), usual);
  const vague = new Error(`The region does not determine a ${name}: show more of it.`);
  if (!(Math.abs(first.q[3]) < FLAT)) throw vague;
  const far = first.used.filter((flag) => !flag).length / n;
  if (!(far <= LIBRARY.maxFarShare)) {
    throw new Error(`${(100 * far).toFixed(0)} % of the region lie off the ${name}: choose less.`);
  }
  const kept = n - Math.floor(LIBRARY.discarded * n);
  const found = settle(body, points, first.q, (sizes) => sizes.toSorted()[kept - 1]);
  return figures(body, name, found, { n, kept, mean, scale, towards });
}

/** The figures of a fit in the unit of the points. */
function figures(body, name, { q, used, distances, variances }, { n, kept, mean, scale, towards }) {
  const own = distances.filter((_, i) => used[i]);
  const middle = own.reduce((sum, v) => sum + v, 0) / own.length;
  const variance = own.reduce((sum, v) => sum + (v - middle) ** 2, 0) / own.length;
  if (!(Math.sqrt(variance) <= LIBRARY.maxSpread)) {
    throw new Error(`No ${name} fits the region: choose less.`);
  }
  const alike = times(variances, (variance * kept) / LIBRARY.patches);
  if (!(body.loose(q, alike) <= LIBRARY.maxRelativeSigma)) {
    throw new Error(`The region does not determine a ${name}: show more of it.`);
  }
  const ordered = distances.toSorted();
  const ranges = ordered.subarray(kept - 1).map((v, k) => v - ordered[k]);
  const result = { points: n, deviation: scale * Math.sqrt(variance) };
  result.range = scale * Math.min(...ranges);
  const sign = name === "plane" && dot(q, towards) < 0 ? -1 : 1;
  result.distances = times(distances, sign * scale);
  const place = (part) => mean.map((m, k) => m + scale * part * q[k]);
  const normal = times(q.slice(0, 3), sign);
  if (name === "plane") return { ...result, point: place(q[3]), normal };
  const radiusSigma = scale * Math.sqrt(variances[3] * variance);
  return { ...result, centre: place(1), radius: scale * q[3], radiusSigma };
}
