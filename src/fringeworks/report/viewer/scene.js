// Draws surfaces with WebGL2: a coarse raster while the view moves, all points when it rests.

import { FRAGMENT_SHADER, TABLES, VERTEX_SHADER } from "./assets.js";
import { cornerNormals, edgeRule, fillNormals, measuredPixels, triangles } from "./mesh.js";

// Indices of one call: a software renderer draws them in about a third of a second.
const PART = 1_500_000;
const SAMPLES = 4; // of a pixel at rest; a slow renderer takes one
const REASONS = 3; // mode of the shader that colours by reason

export class Scene {
  constructor(canvas) {
    const wanted = { antialias: false, powerPreference: "high-performance" };
    const gl = canvas.getContext("webgl2", wanted);
    if (!gl) throw new Error("This browser offers no WebGL2, which the picture needs.");
    Object.assign(this, { gl, canvas, program: gl.createProgram(), places: null });
    // The graphics process compiles while the page unpacks: nothing may ask for the result yet.
    for (const [type, text] of [["VERTEX", VERTEX_SHADER], ["FRAGMENT", FRAGMENT_SHADER]]) {
      const shader = gl.createShader(gl[`${type}_SHADER`]);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    gl.enable(gl.DEPTH_TEST);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    this.offscreen = gl.createFramebuffer();
    this.stores = { RGBA8: gl.createRenderbuffer(), DEPTH_COMPONENT24: gl.createRenderbuffer() };
  }

  /** Upload a surface's points; returns what `draw` takes. */
  add(surface) {
    const { gl } = this;
    const mesh = { surface, array: gl.createVertexArray(), levels: new Map(), normalsOf: 0 };
    mesh.rule = surface.header.raster ? edgeRule(surface) : null;
    mesh.normals = new Int8Array(4 * surface.reason.length);
    gl.bindVertexArray(mesh.array);
    const attributes = [
      [surface.shown, 3, gl.FLOAT],
      [mesh.normals, 4, gl.BYTE],
      [4 * surface.reason.length, 1, gl.FLOAT],
    ];
    mesh.buffers = this.upload(attributes);
    return mesh;
  }

  /** Buffers of the attributes of the bound vertex array: data or their size, components, type. */
  upload(attributes) {
    const { gl } = this;
    return attributes.map(([data, size, type], place) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, type === gl.BYTE, 0, 0);
      return buffer;
    });
  }

  /** Upload the drawing's mesh, which stands behind the surface; `at` makes places of points. */
  addModel({ vertices, faces }, at) {
    const { gl } = this;
    const places = at(vertices);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const none = new Float32Array(places.length / 3).fill(NaN);
    const kinds = [
      [places, 3, gl.FLOAT],
      [cornerNormals(places, faces), 4, gl.BYTE],
      [none, 1, gl.FLOAT],
    ];
    const buffers = this.upload(kinds);
    gl.bindVertexArray(null);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    return { array, buffers: [...buffers, buffer], list: { buffer, count: faces.length } };
  }

  /** Give back what a surface holds of the graphics processor. */
  remove({ array, buffers, levels = new Map(), model }) {
    if (model) this.remove(model);
    const lists = [...levels.values()].flatMap((level) => Object.values(level));
    for (const buffer of [...buffers, ...lists.map((list) => list.buffer)]) {
      this.gl.deleteBuffer(buffer);
    }
    this.gl.deleteVertexArray(array);
  }

  /** Set the numbers that colour a surface. */
  setValues(mesh, values, place = 2) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.buffers[place]);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
  }

  /** Set the 256 colours of a scale, or those of the reasons. */
  setScale(name) {
    const { gl } = this;
    const bytes = new Uint8Array(Uint32Array.from(TABLES[name]).buffer);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  }

  /** Lists of every k-th pixel's triangles, gaps and points, made when first asked for. */
  level(mesh, stride) {
    if (mesh.levels.has(stride)) return mesh.levels.get(stride);
    const { gl } = this;
    const { surface, rule } = mesh;
    if (rule && mesh.normalsOf !== 1) {
      fillNormals(surface, rule, stride, mesh.normals);
      mesh.normalsOf = stride;
      this.setValues(mesh, mesh.normals, 1);
    }
    const lists = { points: measuredPixels(surface, stride) };
    if (rule) Object.assign(lists, triangles(surface, rule, stride));
    gl.bindVertexArray(null);
    for (const [name, list] of Object.entries(lists)) {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, list, gl.STATIC_DRAW);
      lists[name] = { buffer, count: list.length };
    }
    mesh.levels.set(stride, lists);
    return lists;
  }

  /** The calls of a picture: for every surface its lists, in parts. */
  *calls(meshes, look, stride) {
    for (const [panel, mesh] of meshes.entries()) {
      const { points, faces, gaps } = this.level(mesh, stride);
      if (mesh.model && look.model) {
        const { array, list } = mesh.model;
        const call = { panel, mesh: { array }, type: this.gl.TRIANGLES, list, from: 0 };
        yield { ...call, count: list.count, gap: true, clears: true };
      }
      const solid = !look.points && faces?.count ? faces : points;
      for (const list of look.gaps && gaps ? [solid, gaps] : [solid]) {
        const type = list === points ? this.gl.POINTS : this.gl.TRIANGLES;
        for (let from = 0; from < list.count; from += PART) {
          const count = Math.min(PART, list.count - from);
          yield { panel, mesh, type, list, from, count, gap: list === gaps };
        }
      }
    }
  }

  /** Make one call into a panel; `view` is of all panels alike. */
  issue({ panel, mesh, type, list, from, count, gap, clears }, view, look, stride) {
    const { gl, canvas } = this;
    const [width, height] = [view.width, view.height].map((v) => Math.round(v * view.density));
    gl.viewport(panel * width, canvas.height - height, width, height);
    const uniforms = { ...look.uniforms, view: view.clip, turn: view.turn.toFloat32Array() };
    uniforms.size = Math.max(1, stride * view.spacing * view.density * 1.1);
    const reasons = look.uniforms.mode === REASONS;
    const reasoned = reasons && !clears;
    if (gap) Object.assign(uniforms, { plain: look.gap, mode: reasoned ? REASONS : 0, light: 0 });
    if (clears) uniforms.light = 1;
    for (const [name, value] of Object.entries(uniforms)) {
      const place = (this.places[name] ??= gl.getUniformLocation(this.program, `u_${name}`));
      if (value.length === 16) gl.uniformMatrix4fv(place, false, value);
      else if (value.length) gl[`uniform${value.length}fv`](place, value);
      else gl.uniform1f(place, value);
    }
    gl.bindVertexArray(mesh.array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, list.buffer);
    gl.drawElements(type, count, gl.UNSIGNED_INT, 4 * from);
    // What was measured stands before the drawing, also where it lies behind it by a dent.
    if (clears) gl.clear(gl.DEPTH_BUFFER_BIT);
  }

  /** Draw every k-th pixel at once. */
  draw(meshes, view, look, stride) {
    cancelAnimationFrame(this.waiting);
    this.begin(null);
    for (const call of this.calls(meshes, look, stride)) this.issue(call, view, look, stride);
  }

  /** An empty picture. The program is checked when the first one is drawn. */
  begin(target) {
    const { gl, program } = this;
    if (!this.places && !gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(`The picture cannot be drawn: ${gl.getProgramInfoLog(program)}`);
    }
    this.places ??= {};
    gl.useProgram(program);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /** Draw all pixels in parts beside the screen, smoothly, then show them; `draw` stops it. */
  refine(meshes, view, look, smooth, done) {
    cancelAnimationFrame(this.waiting);
    const { gl, canvas: { width, height } } = this;
    this.resize(width, height, smooth ? SAMPLES : 0);
    this.begin(this.offscreen);
    const calls = this.calls(meshes, look, 1);
    let fence = null;
    const tick = () => {
      this.waiting = requestAnimationFrame(tick);
      if (fence && gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) return;
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.offscreen);
      const { value, done: finished } = calls.next();
      if (!finished) this.issue(value, view, look, 1);
      fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      if (!finished) return;
      cancelAnimationFrame(this.waiting);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
      done();
    };
    tick();
  }

  /** Give the picture beside the screen a size and several samples per pixel. */
  resize(width, height, samples) {
    const { gl } = this;
    if (this.size === `${width} ${height} ${samples}`) return;
    this.size = `${width} ${height} ${samples}`;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.offscreen);
    for (const [format, store] of Object.entries(this.stores)) {
      const place = format === "RGBA8" ? gl.COLOR_ATTACHMENT0 : gl.DEPTH_ATTACHMENT;
      gl.bindRenderbuffer(gl.RENDERBUFFER, store);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, gl[format], width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, store);
    }
  }
}
