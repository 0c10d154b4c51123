// Draws surfaces with WebGL2: a coarse raster while the view moves, all points when it rests.

import { edgeRule, fillNormals, triangles, usualDistance } from "./mesh.js";
import { FRAGMENT_SHADER, SCALES, VERTEX_SHADER } from "./assets.js";

// Indices of one call: a software renderer draws them in about a third of a second.
const PART = 1_500_000;
const SAMPLES = 4; // of a pixel at rest; a slow renderer takes one
const rgb = (hex) => [0, 2, 4].map((k) => parseInt(hex.slice(k, k + 2), 16));

/** Red, green and blue, 0…255, at a place 0…1 of a scale. */
export function scaleColour(name, place) {
  const colours = SCALES[name];
  const at = Math.min(Math.max(place, 0), 1) * (colours.length - 1);
  const low = Math.min(Math.floor(at), colours.length - 2);
  const [a, b] = [rgb(colours[low]), rgb(colours[low + 1])];
  return a.map((v, k) => Math.round(v + (b[k] - v) * (at - low)));
}

export class Scene {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      powerPreference: "high-performance",
    });
    if (!gl) throw new Error("This browser offers no WebGL2, which the picture needs.");
    this.gl = gl;
    this.canvas = canvas;
    // The graphics process compiles while the page unpacks: nothing may ask for the result yet.
    this.program = started(gl);
    this.places = null;
    gl.enable(gl.DEPTH_TEST);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  }

  /** Upload a surface's points; returns what `draw` takes. */
  add(surface) {
    const { gl } = this;
    const mesh = { surface, array: gl.createVertexArray(), levels: new Map(), normalsOf: 0 };
    mesh.rule = surface.raster ? edgeRule(surface) : null;
    mesh.side = mesh.rule?.side ?? usualDistance(surface);
    mesh.normals = new Int8Array(4 * surface.reason.length);
    mesh.buffers = [surface.shown, mesh.normals, 4 * surface.reason.length].map((data, place) => {
      const buffer = gl.createBuffer();
      gl.bindVertexArray(mesh.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      const [size, type] = [
        [3, gl.FLOAT],
        [4, gl.BYTE],
        [1, gl.FLOAT],
      ][place];
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, type === gl.BYTE, 0, 0);
      return buffer;
    });
    return mesh;
  }

  /** Set the numbers that colour a surface. */
  setValues(mesh, values) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffers[2]);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
  }

  /** Set the 256 colours of a scale, or those of the reasons. */
  setScale(name) {
    const { gl } = this;
    const bytes = new Uint8Array(4 * 256);
    for (let k = 0; k < 256; k++) {
      const own =
        name === "reasons" ? rgb(SCALES.reasons[k] ?? "000000") : scaleColour(name, k / 255);
      bytes.set([...own, 255], 4 * k);
    }
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  }

  /** Lists of every k-th pixel's triangles, gaps and points, made when first asked for. */
  level(mesh, stride) {
    if (mesh.levels.has(stride)) return mesh.levels.get(stride);
    const { surface } = mesh;
    const { gl } = this;
    if (surface.raster && mesh.normalsOf !== 1 && mesh.normalsOf !== stride) {
      fillNormals(surface, mesh.rule, stride, mesh.normals);
      mesh.normalsOf = stride;
      gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffers[1]);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, mesh.normals);
    }
    const lists = surface.raster ? triangles(surface, mesh.rule, stride) : {};
    lists.points = measuredPixels(surface, stride);
    const level = {};
    gl.bindVertexArray(null);
    for (const [name, list] of Object.entries(lists)) {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, list, gl.STATIC_DRAW);
      level[name] = { buffer, count: list.length };
    }
    mesh.levels.set(stride, level);
    return level;
  }

  /** The calls of a picture: for every surface its lists, in parts. */
  *calls(meshes, look, stride) {
    for (const [panel, mesh] of meshes.entries()) {
      const level = this.level(mesh, stride);
      const solid = !look.points && level.faces?.count ? level.faces : level.points;
      const lists = look.gaps && level.gaps ? [solid, level.gaps] : [solid];
      for (const list of lists) {
        const type = list === level.points ? this.gl.POINTS : this.gl.TRIANGLES;
        for (let from = 0; from < list.count; from += PART) {
          const count = Math.min(PART, list.count - from);
          yield { panel, mesh, type, list, from, count, gap: list === level.gaps };
        }
      }
    }
  }

  /** Make one call into a panel; `view` is of all panels alike. */
  issue(call, view, look, stride) {
    const { gl, canvas } = this;
    const width = Math.round(view.width * view.density);
    const height = Math.round(view.height * view.density);
    gl.viewport(call.panel * width, canvas.height - height, width, height);
    gl.uniformMatrix4fv(this.place("u_view"), false, view.clip);
    gl.uniformMatrix3fv(this.place("u_turn"), true, view.turn.flat());
    gl.uniform1f(this.place("u_size"), Math.max(1, stride * view.spacing * view.density * 1.1));
    gl.uniform2fv(this.place("u_range"), look.range);
    gl.uniform3fv(this.place("u_low"), look.low);
    gl.uniform3fv(this.place("u_high"), look.high);
    gl.uniform3fv(this.place("u_plain"), call.gap ? look.gapColour : look.plain);
    gl.uniform1i(this.place("u_mode"), call.gap && look.mode !== 3 ? 0 : look.mode);
    gl.uniform1i(this.place("u_light"), look.light && !call.gap);
    gl.uniform1i(this.place("u_hide"), look.hide);
    gl.bindVertexArray(call.mesh.array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, call.list.buffer);
    gl.drawElements(call.type, call.count, gl.UNSIGNED_INT, 4 * call.from);
  }

  /** Use the program; it is checked when the first picture is drawn. */
  use() {
    const { gl, program } = this;
    if (this.places) return;
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(`The picture cannot be drawn: ${gl.getProgramInfoLog(program)}`);
    }
    gl.useProgram(program);
    this.places = {};
  }

  place(name) {
    this.places[name] ??= this.gl.getUniformLocation(this.program, name);
    return this.places[name];
  }

  clear(look) {
    this.gl.clearColor(...look.background, 1);
    this.gl.clear(this.gl.COLOR_BUFFER_BIT | this.gl.DEPTH_BUFFER_BIT);
  }

  /** Draw every k-th pixel at once. */
  draw(meshes, view, look, stride) {
    this.stop();
    this.use();
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, null);
    this.clear(look);
    for (const call of this.calls(meshes, look, stride)) this.issue(call, view, look, stride);
  }

  /** Draw all pixels in parts beside the screen, smoothly, then show them; `draw` stops it. */
  refine(meshes, view, look, smooth, done) {
    this.stop();
    const { gl, canvas } = this;
    const target = this.offscreen(smooth ? SAMPLES : 0);
    const calls = this.calls(meshes, look, 1);
    let fence = null;
    let cleared = false;
    const tick = () => {
      this.waiting = requestAnimationFrame(tick);
      if (fence && gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) return;
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      if (!cleared) this.clear(look);
      cleared = true;
      const { value, done: finished } = calls.next();
      if (!finished) this.issue(value, view, look, 1);
      fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      if (!finished) return;
      this.stop();
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
      const { width, height } = canvas;
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
      done();
    };
    tick();
  }

  stop() {
    cancelAnimationFrame(this.waiting);
  }

  /** A framebuffer of the canvas's size with several samples per pixel. */
  offscreen(samples) {
    const { gl, canvas } = this;
    const size = `${canvas.width} ${canvas.height} ${samples}`;
    if (this.target?.size === size) return this.target.buffer;
    for (const old of this.target?.stores ?? []) gl.deleteRenderbuffer(old);
    if (this.target) gl.deleteFramebuffer(this.target.buffer);
    const buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    const kinds = [
      [gl.RGBA8, gl.COLOR_ATTACHMENT0],
      [gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT],
    ];
    const stores = kinds.map(([format, place]) => {
      const store = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, store);
      gl.renderbufferStorageMultisample(
        gl.RENDERBUFFER,
        samples,
        format,
        canvas.width,
        canvas.height,
      );
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, store);
      return store;
    });
    this.target = { size, buffer, stores };
    return buffer;
  }
}

function started(gl) {
  const program = gl.createProgram();
  for (const [type, text] of [
    [gl.VERTEX_SHADER, VERTEX_SHADER],
    [gl.FRAGMENT_SHADER, FRAGMENT_SHADER],
  ]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return program;
}

function measuredPixels({ reason, width, raster }, stride) {
  const every = raster ? stride : stride * stride;
  const found = new Uint32Array(reason.length);
  let n = 0;
  for (let y = 0; y < reason.length / width; y += raster ? stride : 1) {
    for (let i = y * width; i < (y + 1) * width; i += every) if (!reason[i]) found[n++] = i;
  }
  return found.slice(0, n);
}
