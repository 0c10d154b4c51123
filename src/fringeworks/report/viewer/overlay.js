// What is drawn over and beside the surface with the 2-D canvas: scale bar, axes, marks, charts.

import { scaleColour } from "./scene.js";

const FONT = "12px system-ui, sans-serif";
const MARGIN = 14;
const TITLE_PX = 62; // below the readout, which takes one line or two
const BAR_PX = 8; // height of the colour scale below the histogram

/** A cleared canvas of its size on the page, with a context in CSS pixels. */
function fresh(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const density = globalThis.devicePixelRatio || 1;
  const size = [Math.round(width * density), Math.round(height * density)];
  // A new size clears the canvas, but takes long: in most frames it stays.
  if (canvas.width !== size[0]) [canvas.width] = size;
  if (canvas.height !== size[1]) [, canvas.height] = size;
  const context = canvas.getContext("2d");
  context.setTransform(density, 0, 0, density, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = FONT;
  return { context, width, height };
}

/** A colour that the style sheet defines. */
export function ink(canvas, name) {
  return getComputedStyle(canvas).getPropertyValue(name).trim();
}

/** 1, 2 or 5 times a power of ten, at most `limit`. */
function roundLength(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  return power * ([5, 2].find((k) => k * power <= limit) ?? 1);
}

/** Scale bar, axes, the picks, the region and the crosshair over one panel per surface. */
export function drawOver(canvas, { view, active, picks, frame, cross, unit, names }) {
  const { context, height } = fresh(canvas);
  context.lineWidth = 1.5;
  for (let panel = 0; panel < active.length; panel++) {
    context.save();
    context.translate(panel * view.width, 0);
    if (panel) stroke(context, ink(canvas, "--line"), [[0, 0], [0, height]]);
    if (names) plate(context, canvas, names[panel], MARGIN, TITLE_PX);
    drawAxes(context, canvas, view);
    picks.forEach((at, k) => drawMark(context, canvas, view.project(at), "AB"[k]));
    context.restore();
  }
  if (unit) drawScaleBar(context, canvas, view, unit);
  context.setLineDash([5, 3]);
  if (frame) {
    const [x, y, right, bottom] = frame;
    context.strokeStyle = ink(canvas, "--accent");
    context.strokeRect(x, y, right - x, bottom - y);
  }
  context.setLineDash([]);
  if (!cross) return;
  const [x, y] = cross;
  for (const [dx, dy] of [[1, 0], [0, 1]]) {
    const arms = [[x - 16 * dx, y - 16 * dy], [x + 16 * dx, y + 16 * dy]];
    stroke(context, ink(canvas, "--accent"), arms);
  }
}

function stroke(context, colour, points) {
  context.strokeStyle = colour;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}

/** Text on a plate, so that it reads on any surface. */
function plate(context, canvas, text, x, y) {
  const { width } = context.measureText(text);
  context.fillStyle = ink(canvas, "--plate");
  context.fillRect(x - 3, y - 12, width + 6, 16);
  context.fillStyle = ink(canvas, "--ink");
  context.fillText(text, x, y);
}

function drawScaleBar(context, canvas, view, unit) {
  const length = roundLength(Math.min(180, view.width / 3) / view.scale);
  const [x, y] = [MARGIN, view.height - MARGIN];
  const end = x + length * view.scale;
  stroke(context, ink(canvas, "--ink"), [[x, y - 5], [x, y], [end, y], [end, y - 5]]);
  plate(context, canvas, `${Number(length.toPrecision(1))} ${unit}`, x + 6, y - 8);
}

function drawAxes(context, canvas, view) {
  const [x, y] = [view.width - 46, view.height - 46];
  for (const [k, name] of ["x", "y", "z"].entries()) {
    const [dx, dy] = [28 * view.turn[0][k], -28 * view.turn[1][k]];
    stroke(context, ink(canvas, `--${name}-axis`), [[x, y], [x + dx, y + dy]]);
    plate(context, canvas, name, x + 1.3 * dx - 3, y + 1.3 * dy + 4);
  }
}

function drawMark(context, canvas, [x, y], name) {
  context.fillStyle = ink(canvas, "--accent");
  context.strokeStyle = ink(canvas, "--plate");
  context.beginPath();
  context.arc(x, y, 5, 0, 2 * Math.PI);
  context.fill();
  context.stroke();
  plate(context, canvas, name, x + 10, y - 8);
}

/** Histogram over its colour scale; `low` and `high` are the range's ends, 0…1. */
export function drawHistogram(canvas, bins, kind, low, high) {
  const { context, width, height } = fresh(canvas);
  const [column, top] = [width / bins.length, Math.max(1, ...bins)];
  for (const [k, count] of bins.entries()) {
    const place = ((k + 0.5) / bins.length - low) / (high - low);
    context.fillStyle = `rgb(${scaleColour(kind.scale, kind.flip ? 1 - place : place)})`;
    context.fillRect(k * column, height - BAR_PX, column + 1, BAR_PX);
    context.fillStyle = ink(canvas, place >= 0 && place <= 1 ? "--bars" : "--line");
    const size = (height - BAR_PX - 4) * Math.sqrt(count / top);
    context.fillRect(k * column, height - BAR_PX - 2 - size, Math.max(column - 0.5, 0.5), size);
  }
}

/** A profile: heights with a band of ± σ over the distance along the line. */
export function drawChart(canvas, samples, unit, digits) {
  const { context, width, height } = fresh(canvas);
  const known = samples.filter(({ values }) => !Number.isNaN(values[0]));
  const reach = (k, sign) => sign * Math.max(...known.map(({ values }) => sign * values[k]));
  const [left, right, low, high] = [reach(0, -1), reach(0, 1), reach(1, -1), reach(1, 1)];
  const tall = Math.max(high - low, 1e-9);
  const x = (v) => 62 + ((width - 70) * (v - left)) / (right - left || 1);
  const y = (v) => height - 26 - ((height - 54) * (v - low)) / tall;
  for (const { values: [along, up, sigma] } of known) {
    context.fillStyle = ink(canvas, "--band");
    context.fillRect(x(along) - 1, y(up + sigma), 2, Math.max(1, y(up - sigma) - y(up + sigma)));
  }
  let run = [];
  for (const { values: [along, up] } of [...samples, { values: [NaN, NaN] }]) {
    if (!Number.isNaN(along)) run.push([x(along), y(up)]);
    else if (run.length) stroke(context, ink(canvas, "--accent"), run);
    if (Number.isNaN(along)) run = [];
  }
  const label = (text, across, down) => plate(context, canvas, text, across, down);
  label(`Height over the line A–B, ${unit}`, 4, 13);
  label(high.toFixed(digits), 4, 32);
  label(low.toFixed(digits), 4, height - 22);
  label("A", 4, height - 4);
  label(`B, ${right.toFixed(digits)} ${unit}`, width - 96, height - 4);
}
