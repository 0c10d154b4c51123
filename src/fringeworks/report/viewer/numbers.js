// Vectors, quantiles, ranges, and small things for the page.

const SAMPLED = 30_000; // values of a layer, about, that its range and histogram come from
const BINS = 120;
// Shares of the values below the ends of a range: outliers do not widen the colour scale. Signed
// values are largest at rims, so that their range leaves out more.
const ENDS = [0.002, 0.998];
const SIGNED_ENDS = [0.02, 0.98];

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, k) => a.map((v) => v * k);
export const unit = (a) => times(a, 1 / Math.hypot(...a));
export const percent = (share) => `${(100 * share).toFixed(1)} %`;

/** An array of numbers by their places; `from` with a function is ten times slower. */
export function filled(Type, n, at) {
  const out = new Type(n);
  for (let i = 0; i < n; i++) out[i] = at(i);
  return out;
}

/** A quantile of the numbers in a typed array; NaN counts as nothing. */
export function quantile(values, share) {
  const known = values.filter((v) => !Number.isNaN(v)).sort();
  const place = share * (known.length - 1);
  const low = Math.floor(place);
  return known[low] + (place - low) * ((known[low + 1] ?? known[low]) - known[low]);
}

/** The range of nearly all values, about 0 for signed ones; and how many lie in each bin of it. */
export function spread(values, signed) {
  const every = Math.max(1, Math.floor(values.length / SAMPLED));
  const some = filled(Float64Array, Math.ceil(values.length / every), (k) => values[k * every]);
  let [low, high] = (signed ? SIGNED_ENDS : ENDS).map((share) => quantile(some, share) || 0);
  if (signed) [low, high] = [-1, 1].map((side) => side * Math.max(-low, high));
  if (!(high > low)) [low, high] = [low - 0.5, low + 0.5];
  const bins = Array.from({ length: BINS }, () => 0);
  for (const v of some) if (v >= low && v < high) bins[(BINS * (v - low)) / (high - low) | 0]++;
  return { low, high, bins };
}

/** Digits after the point so that a number with this σ is not cut. */
export function decimals(sigma) {
  return sigma > 0 ? Math.min(Math.max(Math.ceil(-Math.log10(sigma)) + 1, 0), 7) : 4;
}

/** An element with text; text is never markup. */
export function make(tag, text = "") {
  return Object.assign(document.createElement(tag), { textContent: text });
}
