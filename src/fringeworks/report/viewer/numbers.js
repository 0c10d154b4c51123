// Vectors, quantiles, ranges, and small things for the page.

const SAMPLED = 30_000; // values of a layer, about, that its range and histogram come from
const BINS = 120;
// Shares of the values below the ends of a range: outliers do not widen the colour scale. Signed
// values are largest at rims, so that their range leaves out more.
const ENDS = [0.002, 0.998];
// σ has a long tail at rims, which would turn the rest into one colour.
const ENDS_OF = { signed: [0.02, 0.98], spread: [0, 0.98] };
const SIGMA_MEDIANS = 4; // most medians of σ at the end of its scale, as in maps.py
const SIGMA_DIGITS = 2; // significant digits of a σ, which decide the last digit of its value
const PLAIN_DIGITS = 3; // significant digits of a value without a σ
const MOST_DECIMALS = 7;

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, k) => a.map((v) => v * k);
export const unit = (a) => times(a, 1 / Math.hypot(...a));

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

/** The ends of a scale for values, or given ones: the range of nearly all, about 0 for signed
 * values, from 0 for σ; and how many values lie in each bin between them. */
export function spread(values, scale, given) {
  const every = Math.max(1, Math.floor(values.length / SAMPLED));
  const some = filled(Float64Array, Math.ceil(values.length / every), (k) => values[k * every]);
  const ends = given ?? (ENDS_OF[scale] ?? ENDS).map((share) => quantile(some, share) || 0);
  let [low, high] = ends;
  if (scale === "signed") [low, high] = [-1, 1].map((side) => side * Math.max(-low, high));
  if (scale === "spread" && !given) {
    const usual = SIGMA_MEDIANS * quantile(some, 0.5);
    [low, high] = [0, usual > 0 ? Math.min(high, usual) : high];
  }
  if (!(high > low)) [low, high] = [low - 0.5, low + 0.5];
  const bins = Array.from({ length: BINS }, () => 0);
  for (const v of some) if (v >= low && v < high) bins[(BINS * (v - low)) / (high - low) | 0]++;
  return { low, high, bins, some, known: some.filter((v) => !Number.isNaN(v)).length };
}

/** Decimals of a number's last significant digit: two digits of σ, as in types/numbers.py. */
export function decimals(sigma, digits = SIGMA_DIGITS) {
  if (!(Math.abs(sigma) > 0)) return MOST_DECIMALS;
  const power = Number(Math.abs(sigma).toExponential(digits - 1).split("e")[1]);
  return Math.min(Math.max(digits - 1 - power, 0), MOST_DECIMALS);
}

/** A value with these decimals, and the sign as it is printed. */
export function fixed(value, places) {
  const text = value.toFixed(places);
  return Number(text) ? text.replace("-", "−") : text.replace("-", "");
}

/** A value with the digits of its σ; three significant digits where it has none. */
export function number(value, sigma = NaN) {
  if (!Number.isFinite(value)) return "–";
  if (sigma > 0) return fixed(value, decimals(sigma));
  return value ? fixed(value, decimals(value, PLAIN_DIGITS)) : "0";
}

/** A standard deviation with two significant digits. */
export const sigmaText = (sigma) => number(sigma, sigma);

/** A share as percent, with enough digits to tell few from none and most from all. */
export function percent(share) {
  const rest = 100 * Math.min(share, 1 - share);
  const digits = rest > 0 ? Math.max(1, Math.ceil(-Math.log10(rest))) : 1;
  return `${(100 * share).toFixed(digits)} %`;
}

/** An element with text; text is never markup. */
export function make(tag, text = "") {
  return Object.assign(document.createElement(tag), { textContent: text });
}
