// Triangles, normals and screen places of a surface. Their rules are those of the library.

// Pixels to either side between which a normal's slopes are taken: noise is averaged over 5 × 5.
const NORMAL_REACH = 2;

/** What bridges a step, where no surface was seen: `apart` tells it of two pixels, `cut` of the
 * triangle of three; framing.py writes the limits. */
export function edgeRule({ points, header: { edges } }) {
  const { limit, lateral, per_depth: perDepth, cosine } = edges;
  const square = (i, j) => {
    const x = points[3 * i] - points[3 * j];
    const y = points[3 * i + 1] - points[3 * j + 1];
    const z = points[3 * i + 2] - points[3 * j + 2];
    return lateral * (x * x + y * y) + z * z;
  };
  const allowed = (i, pixels) => (limit * pixels * (perDepth ? points[3 * i + 2] : 1)) ** 2;
  return {
    apart: (i, j, pixels) => square(i, j) > allowed(i, pixels),
    cut: (i, j, k, pixels) =>
      Math.max(square(i, j), square(j, k), square(k, i)) > allowed(i, pixels) ||
      grazes(points, 3 * i, 3 * j, 3 * k, cosine),
  };
}

/** Whether a triangle is seen at a grazing angle. */
function grazes(p, i, j, k, cosine) {
  const [ax, ay, az] = [p[j] - p[i], p[j + 1] - p[i + 1], p[j + 2] - p[i + 2]];
  const [bx, by, bz] = [p[k] - p[i], p[k + 1] - p[i + 1], p[k + 2] - p[i + 2]];
  const [x, y, z] = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
  const seen = x * p[i] + y * p[i + 1] + z * p[i + 2];
  const size = (x * x + y * y + z * z) * (p[i] ** 2 + p[i + 1] ** 2 + p[i + 2] ** 2);
  return seen * seen < cosine ** 2 * size;
}

/** Triangles of every k-th pixel, as cloud_triangles and height_map_triangles make them (faces),
 * and those with a corner that has a reason instead of a value (gaps). */
export function triangles({ points, width, height, reason }, rule, stride) {
  const cells = Math.floor((width - 1) / stride) * Math.floor((height - 1) / stride);
  const list = new Uint32Array(6 * Math.max(cells, 0)); // faces from the front, gaps from the back
  let [faces, gaps] = [0, list.length];
  const joined = (p, q) => !Number.isNaN(points[3 * p]) && !rule.apart(p, q, stride);
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
    for (let a = y * width; a + stride < (y + 1) * width; a += stride) {
      const c = a + stride * width;
      add(a, c, a + stride);
      add(a + stride, c, c + stride);
    }
  }
  return { faces: list.subarray(0, faces), gaps: list.subarray(gaps) };
}

/** Every k-th pixel that has a value. */
export function measuredPixels({ reason, width, header: { raster } }, stride) {
  const every = raster ? stride : stride * stride;
  const found = new Uint32Array(reason.length);
  let n = 0;
  for (let row = 0; row < reason.length; row += width * (raster ? stride : 1)) {
    for (let i = row; i < row + width; i += every) if (!reason[i]) found[n++] = i;
  }
  return found.subarray(0, n);
}

/** Write unit normals of every k-th pixel, towards the camera, as bytes; 0 where unknown. */
export function fillNormals({ shown, width, height, reason }, rule, stride, out) {
  const sum = new Float64Array(6);
  // A few steps away; the pixel itself where that is outside, unmeasured, or beyond a step.
  const reached = (m, step, inside) => {
    const to = m + NORMAL_REACH * step;
    return inside && !reason[to] && !rule.apart(to, m, NORMAL_REACH) ? to : m;
  };
  const addSlope = (at, m, step, place, size) => {
    const from = reached(m, -step, place >= NORMAL_REACH);
    const to = reached(m, step, place + NORMAL_REACH < size);
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

/** Visit the pixels whose points lie in a rectangle of the screen, with column, row, nearness. */
export function within({ shown }, toScreen, [left, top, right, bottom], visit) {
  const { m11, m21, m31, m41, m12, m22, m32, m42, m13, m23, m33 } = toScreen;
  for (let i = 0, at = 0; at < shown.length; i++, at += 3) {
    const [x, y, z] = [shown[at], shown[at + 1], shown[at + 2]];
    const column = m11 * x + m21 * y + m31 * z + m41;
    if (!(column >= left && column <= right)) continue;
    const row = m12 * x + m22 * y + m32 * z + m42;
    if (row >= top && row <= bottom) visit(i, column, row, m13 * x + m23 * y + m33 * z);
  }
}

/** Normals of a mesh's corners, as four bytes each: the sum of those of its triangles. */
export function cornerNormals(places, faces) {
  const sums = new Float64Array(places.length);
  const at = (i) => [places[3 * i], places[3 * i + 1], places[3 * i + 2]];
  for (let k = 0; k < faces.length; k += 3) {
    const corners = [faces[k], faces[k + 1], faces[k + 2]];
    const [a, b, c] = corners.map(at);
    const [u, v] = [b, c].map((p) => p.map((x, m) => x - a[m]));
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const i of corners) for (let m = 0; m < 3; m++) sums[3 * i + m] += n[m];
  }
  const out = new Int8Array((4 * places.length) / 3);
  for (let i = 0; i < places.length / 3; i++) {
    const size = Math.hypot(sums[3 * i], sums[3 * i + 1], sums[3 * i + 2]) || 1;
    for (let m = 0; m < 3; m++) out[4 * i + m] = Math.round((127 * sums[3 * i + m]) / size);
  }
  return out;
}
