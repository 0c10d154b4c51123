// Vectors, quantiles, ranges, and small things for the page.

// Values, about, that quantiles and histograms come from.
const SAMPLED_VALUES = 30_000;
const BINS = 120;
// Shares of the values below the ends of a range: outliers do not widen the colour scale. Signed
// values are largest at rims, so that their range leaves out more.
const ENDS = [0.002, 0.998];
const SIGNED_ENDS = [0.02, 0.98];

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, k) => a.map((v) => v * k);
export const unit = (a) => times(a, 1 / Math.hypot(...a));

export function cross(a, b) {
  const [x, y, z] = a;
  return [y * b[2] - z * b[1], z * b[0] - x * b[2], x * b[1] - y * b[0]];
}

/** An array of numbers by their places; `from` with a function is ten times slower. */
export function filled(Type, n, at) {
  const out = new Type(n);
  for (let i = 0; i < n; i++) out[i] = at(i);
  return out;
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

/** Some of n values, evenly chosen. */
function sampled(n, at) {
  const every = Math.max(1, Math.floor(n / SAMPLED_VALUES));
  return filled(Float64Array, Math.floor((n - 1) / every) + 1, (k) => at(k * every));
}

/** The box that holds nearly all measured points: its middle and half its sides. */
export function bounds({ points, reason }) {
  const ends = [0, 1, 2].map((k) => {
    const some = sampled(reason.length, (i) => (reason[i] ? NaN : points[3 * i + k]));
    return ENDS.map((share) => quantile(some, share));
  });
  const centre = ends.map(([low, high]) => (low + high) / 2 || 0);
  return { centre, half: ends.map(([low, high]) => (high - low) / 2 || 0.5) };
}

/** The range of nearly all values, about 0 for signed ones; and how many lie in each bin of it. */
export function spread(values, signed) {
  const some = sampled(values.length, (i) => values[i]);
  let [low, high] = (signed ? SIGNED_ENDS : ENDS).map((share) => quantile(some, share));
  if (Number.isNaN(low)) [low, high] = [0, 1];
  if (signed) [low, high] = [-1, 1].map((side) => side * Math.max(-low, high));
  if (!(high > low)) [low, high] = [low - 0.5, low + 0.5];
  const bins = Array.from({ length: BINS }, () => 0);
  for (const v of some) {
    if (v >= low && v < high) bins[Math.floor((BINS * (v - low)) / (high - low))]++;
  }
  return { low, high, bins };
}

/** Digits after the point so that a number with this σ is not cut. */
export function decimals(sigma) {
  if (!(sigma > 0)) return 4;
  return Math.min(Math.max(Math.ceil(-Math.log10(sigma)) + 1, 0), 7);
}

/** An element with text; text is never markup. */
export function make(tag, text = "", properties = {}) {
  return Object.assign(document.createElement(tag), { textContent: text }, properties);
}
