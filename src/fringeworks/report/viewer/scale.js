// The colour scale: its ends, moved by handles or typed, the histogram over it, what lies beyond.

import { SCALES } from "./assets.js";
import { decimals, fixed, percent, spread } from "./numbers.js";

const STEPS = 1000; // of the handles

export class Scale {
  constructor(viewer) {
    Object.assign(this, { viewer, ui: viewer.ui });
  }

  /** Begin with the ends that a layer brings along, or with those of nearly all of its values. */
  begin(layer, { scale, label }) {
    Object.assign(this, { layer, label, colours: SCALES[scale] });
    this.span(spread(layer.values, scale, layer.range));
  }

  /** Let the handles move over a span. */
  span(found) {
    const { ui } = this;
    this.found = found;
    [ui.low.value, ui.high.value] = [0, STEPS];
    const top = Math.max(1, ...found.bins);
    const corners = found.bins.flatMap((count, k) => {
      const down = 100 - 100 * Math.sqrt(count / top);
      return [k, k + 1].map((edge) => `${(100 * edge) / found.bins.length}% ${down}%`);
    });
    ui.histogram.style.clipPath = `polygon(0 100%, ${corners.join(", ")}, 100% 100%)`;
    this.change();
  }

  /** Ends of the colour scale. */
  get range() {
    const { low, high } = this.found;
    return [this.ui.low, this.ui.high].map(({ value }) => low + ((high - low) * value) / STEPS);
  }

  /** The handles have moved. */
  change() {
    const { ui, layer, label, found } = this;
    ui.low.value = Math.min(ui.low.value, ui.high.value - 1);
    const digits = decimals((found.high - found.low) / 10);
    const colours = this.colours.join(", ");
    ui.colours.style.background =
      `linear-gradient(to right, ${colours.replace(",", " var(--low),")} var(--high))`;
    const { range } = this;
    for (const [k, name] of ["low", "high"].entries()) {
      ui.scale.style.setProperty(`--${name}`, `${(100 * ui[name].value) / STEPS}%`);
      ui[`${name}Text`].value = range[k].toFixed(digits);
      ui[name].setAttribute("aria-valuetext", `${fixed(range[k], digits)} ${layer.unit}`);
    }
    ui.unitText.textContent = layer.unit ? `${label}, ${layer.unit}` : label;
    const beyond = found.some.filter((v) => v < range[0] || v > range[1]).length;
    ui.beyond.textContent = beyond ? `beyond the scale: ${percent(beyond / found.known)}` : "";
    this.viewer.move();
  }

  /** Ends were typed: the handles then move between them. */
  type() {
    const { ui, layer } = this;
    const [low, high] = [ui.lowText, ui.highText].map(({ value }) => Number.parseFloat(value));
    if (low < high) this.span(spread(layer.values, "typed", [low, high]));
    else this.change();
  }
}
