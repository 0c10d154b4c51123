// Triangles, normals and picks of a surface. LIBRARY holds the constants of the library's functions
// whose twins these are.

import { LIBRARY } from "./assets.js";
import { bounds, quantile } from "./numbers.js";

// Pixels to either side between which a normal's slopes are taken: noise is averaged over 5 × 5.
const NORMAL_REACH = 2;
// Triangles, about, whose sides give the usual one.
const SAMPLED = 5000;

/** What bridges a step, where no surface was seen: `cut` tells it of the triangle of three pixels,
 * `apart` of two; `side` is the usual distance of neighbours. */
export function edgeRule(surface) {
  return surface.header.kind === "cloud" ? ruleOfCloud(surface) : ruleOfHeights(surface);
}

function ruleOfHeights({ points, header }) {
  const { pitch } = header.place;
  const steepest = LIBRARY.maxSlope * pitch;
  const rise = (i, j) => Math.abs(points[3 * i + 2] - points[3 * j + 2]);
  return {
    side: pitch,
    apart: (i, j, pixels) => rise(i, j) > steepest * pixels,
    cut: (i, j, k, pixels) => Math.max(rise(i, j), rise(j, k), rise(k, i)) > steepest * pixels,
  };
}

function ruleOfCloud(surface) {
  const { points, width, height, reason } = surface;
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

/** Triangles of every k-th pixel, as cloud_triangles and height_map_triangles make them (faces),
 * and those with a corner that has a reason instead of a value (gaps). */
export function triangles(surface, rule, stride) {
  const { points, width, height, reason } = surface;
  const cells = Math.floor((width - 1) / stride) * Math.floor((height - 1) / stride);
  const list = new Uint32Array(6 * Math.max(cells, 0)); // faces from the front, gaps from the back
  let [faces, gaps] = [0, list.length];
  const placed = (p) => !Number.isNaN(points[3 * p]);
  const joined = (p, q) => placed(p) && placed(q) && !rule.apart(p, q, stride);
  const put = (at, i, j, k) => {
    list[at] = i;
    list[at + 1] = j;
    list[at + 2] = k;
  };
  const add = (i, j, k) => {
    if (!reason[i] && !reason[j] && !reason[k]) {
      if (rule.cut(i, j, k, stride)) return;
      put(faces, i, j, k);
      faces += 3;
    } else if (joined(i, j) && joined(j, k) && joined(k, i)) {
      gaps -= 3;
      // WebGL colours a triangle by its last corner, which has to be one that has a reason.
      if (reason[k]) put(gaps, i, j, k);
      else if (reason[j]) put(gaps, k, i, j);
      else put(gaps, j, k, i);
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
  return { faces: list.subarray(0, faces), gaps: list.subarray(gaps) };
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
      const apart = (row - y) ** 2 + (column - x) ** 2;
      if (map[row * width + column] < 0 || apart >= best) continue;
      best = apart;
      found = map[row * width + column];
    }
  }
  return found;
}

/** Rough distance of neighbours in a list of points: they cover their box once. */
export function usualDistance(surface) {
  const { half } = bounds(surface);
  return 2 * Math.sqrt((half[0] * half[1]) / Math.max(surface.header.count, 1));
}
