// The plate in space, by WebGL 2: surface, mesh lines, supports, obstacles and points in contact.

const VERTEX = `#version 300 es
layout(location=0) in vec3 place; layout(location=1) in vec2 slope; layout(location=2) in float value;
uniform mat4 camera; uniform vec3 centre; uniform float size, scale, bulk;
out vec3 normal; out float shade; out vec3 seen;
void main() {
  vec3 p = (place - centre) / size * vec3(1, 1, scale);
  normal = vec3(-scale * slope, 1.0); shade = value; seen = p;
  gl_Position = camera * vec4(p, 1);
  gl_PointSize = bulk;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 normal; in float shade; in vec3 seen;
uniform vec4 color; uniform int mode; uniform vec2 range; uniform vec3 eye;
out vec4 pixel;
vec3 ramp(float s) {
  vec3 stops[5] = vec3[5](vec3(68,1,84), vec3(59,82,139), vec3(33,145,140), vec3(94,201,98), vec3(253,231,37));
  float at = clamp(s, 0.0, 1.0) * 4.0; int i = min(int(at), 3);
  return mix(stops[i], stops[i + 1], at - float(i)) / 255.0;
}
void main() {
  if (mode == 3) { if (length(gl_PointCoord - 0.5) > 0.5) discard; pixel = color; return; }
  vec3 base = color.rgb;
  if (mode == 1) base = isnan(shade) ? vec3(0.6) : ramp((shade - range.x) / (range.y - range.x));
  if (mode == 1 || mode == 2) {
    vec3 n = normalize(normal), view = normalize(eye - seen);
    if (dot(n, view) < 0.0) n = -n;
    float light = 0.62 + 0.38 * max(dot(n, normalize(vec3(-0.35, -0.5, 1.0))), 0.0);
    base *= light;
  }
  pixel = vec4(base * color.a, color.a);
}`;
/** Half the height of the window over its distance. */
const TANGENT = 0.2;
/** Number of corners of a washer. */
const RIM = 24;
const GREY = [0.5, 0.52, 0.56];
const GHOST = [1, 1, 1, 0.5];
const HOME = { turn: -0.6, rise: 0.42, near: 1 };

export class View {
  constructor(canvas, { x, y, triangles, edges, held }) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser offers no WebGL 2");
    Object.assign(this, { canvas, gl, x, y, triangles, edges, held, ...HOME });
    this.program = link(gl);
    const places = {};
    this.place = (name) => (places[name] ??= gl.getUniformLocation(this.program, name));
    const span = (values) => values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
    [this.left, this.right] = span(x);
    [this.front, this.back] = span(y);
    this.size = Math.max(this.right - this.left, this.back - this.front) || 1;
    this.vertices = new Float32Array(6 * x.length);
    this.buffers = { points: gl.createBuffer(), other: gl.createBuffer() };
    this.lists = { triangles: elements(gl, triangles), edges: elements(gl, edges) };
    this.touching = gl.createBuffer();
    this.gradients = gradients(x, y, triangles);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.#listen();
  }

  /** Shows the plate: deflection w, values to colour by with their range, obstacles, contact points. */
  show(state) {
    this.state = state;
    const { gl, vertices, x, y } = this, { w, values } = state;
    this.slopes ??= new Float32Array(2 * x.length);
    this.gradients(w, this.slopes);
    for (let p = 0; p < x.length; p++)
      vertices.set([x[p], y[p], w[p], this.slopes[2 * p], this.slopes[2 * p + 1], values[p]], 6 * p);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers.points);
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.DYNAMIC_DRAW);
    this.draw();
  }

  draw() {
    const { gl, canvas, state } = this;
    if (!state) return;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    const { matrix, eye } = camera(this.turn, this.rise, this.#distance(width / height), width / height);
    gl.uniformMatrix4fv(this.place("camera"), false, matrix);
    gl.uniform3fv(this.place("eye"), eye);
    gl.uniform3f(this.place("centre"), (this.left + this.right) / 2, (this.front + this.back) / 2, state.middle);
    gl.uniform1f(this.place("size"), this.size);
    gl.uniform1f(this.place("scale"), state.scale);
    gl.uniform1f(this.place("bulk"), 7 * ratio);
    gl.uniform2fv(this.place("range"), state.range);

    this.#plate();
    this.#supports();
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    if (state.floor) this.#wall(state.floor, [...GREY, 0.5], -1);
    if (state.ceiling) this.#wall(state.ceiling, [...GREY, 0.22], 1);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    this.#balls(ratio);
    gl.disable(gl.DEPTH_TEST);
    this.#bolts();
    this.#touch();
    gl.enable(gl.DEPTH_TEST);
  }

  /** Returns the distance from which the whole plate fits in the window. */
  #distance(aspect) {
    const radius = Math.hypot(this.right - this.left, this.back - this.front) / (2 * this.size);
    return Math.max((radius + 0.08) / (TANGENT * aspect), (0.45 * radius + 0.22) / TANGENT) / this.near;
  }

  #plate() {
    const { gl, lists } = this;
    this.#attributes(this.buffers.points);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    this.#paint(1, [0, 0, 0, 1]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, lists.triangles);
    gl.drawElements(gl.TRIANGLES, this.triangles.length, gl.UNSIGNED_INT, 0);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.enable(gl.BLEND);
    this.#paint(0, [0, 0, 0, 0.35]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, lists.edges);
    gl.drawElements(gl.LINES, this.edges.length, gl.UNSIGNED_INT, 0);
    gl.disable(gl.BLEND);
  }

  /** Draws a low wall along each held edge. */
  #supports() {
    const { held, x, y, state } = this, corners = [];
    const tall = (0.018 * this.size) / state.scale;
    for (let i = 0; i < held.length; i += 2) {
      const [a, b] = [held[i], held[i + 1]];
      const at = (p, up) => [x[p], y[p], state.w[p] + up * tall, 0, 0, 0];
      for (const corner of [at(a, -1), at(b, -1), at(b, 1), at(a, -1), at(b, 1), at(a, 1)]) corners.push(corner);
    }
    this.#triangles(corners, 0, [...state.ink, 1]);
  }

  /** Draws an obstacle: a rectangle if it is level everywhere, its faces, or pegs at single points. */
  #wall(heights, color, side) {
    const { gl, x, y, triangles, size, state } = this, corners = [], pegs = [];
    const level = heights.every((height) => height === heights[0]) && triangles.length > 0;
    if (level) {
      const more = 0.08 * size, z = heights[0];
      const at = (left, front) => [left ? this.left - more : this.right + more, front ? this.front - more : this.back + more, z, 0, 0, 0];
      corners.push(at(1, 1), at(0, 1), at(0, 0), at(1, 1), at(0, 0), at(1, 0));
    } else {
      const met = new Uint8Array(x.length);
      for (let i = 0; i < triangles.length; i += 3) {
        const face = triangles.subarray(i, i + 3);
        if (face.some((p) => Number.isNaN(heights[p]))) continue;
        for (const p of face) { met[p] = 1; corners.push([x[p], y[p], heights[p], 0, 0, 0]); }
      }
      const wide = 0.012 * size, tall = (0.06 * size) / state.scale;
      for (let p = 0; p < x.length; p++) {
        if (met[p] || Number.isNaN(heights[p])) continue;
        const foot = (dx, dy, dz = side * tall) => [x[p] + dx * wide, y[p] + dy * wide, heights[p] + dz, 0, 0, 0];
        const feet = [foot(1, 1), foot(-1, 1), foot(-1, -1), foot(1, -1)];
        for (let i = 0; i < 4; i++) pegs.push(foot(0, 0, 0), feet[i], feet[(i + 1) % 4]);
      }
    }
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 4);
    this.#triangles(corners, 2, color);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    // Parts that the plate hides shine through it.
    gl.disable(gl.DEPTH_TEST);
    if (!level) this.#triangles(corners.length < triangles.length ? [...corners, ...pegs] : pegs, 0, GHOST);
    gl.enable(gl.DEPTH_TEST);
    this.#triangles(pegs, 2, [...GREY, 1]);
  }

  /** Draws balls, whose size no scene tells, on the point that touches the plate. */
  #balls(ratio) {
    const { gl, state, size } = this;
    const centres = state.balls.map(([x, y, z, side]) => [x, y, z + (side * 0.02 * size) / state.scale, 0, 0, 0]);
    gl.uniform1f(this.place("bulk"), 24 * ratio);
    this.#shapes(gl.POINTS, centres, 3, [0.5, 0.5, 0.55, 1]);
    gl.uniform1f(this.place("bulk"), 7 * ratio);
  }

  /** Draws bolts as dots, and their washers to size. */
  #bolts() {
    const { gl, state } = this, ink = [...state.ink, 1], rims = [];
    const rim = ([x, y, radius, p], i) => {
      const angle = (2 * Math.PI * i) / RIM;
      return [x + radius * Math.cos(angle), y + radius * Math.sin(angle), state.w[p], 0, 0, 0];
    };
    const centres = state.bolts.map(([x, y, , p]) => [x, y, state.w[p], 0, 0, 0]);
    state.bolts.forEach((bolt, b) => {
      for (let i = 0; i < RIM; i++) rims.push(centres[b], rim(bolt, i), rim(bolt, i + 1));
    });
    this.#triangles(rims, 0, ink);
    this.#shapes(gl.POINTS, centres, 3, ink);
  }

  /** Draws dots at points in contact. */
  #touch() {
    const { gl, state: { touch } } = this;
    this.#attributes(this.buffers.points);
    this.#paint(3, [0.9, 0.36, 0, 1]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.touching);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, touch, gl.DYNAMIC_DRAW);
    gl.drawElements(gl.POINTS, touch.length, gl.UNSIGNED_INT, 0);
  }

  #triangles(corners, mode, color) {
    this.#shapes(this.gl.TRIANGLES, corners, mode, color);
  }

  #shapes(kind, corners, mode, color) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers.other);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners.flat()), gl.DYNAMIC_DRAW);
    this.#attributes(this.buffers.other);
    this.#paint(mode, color);
    gl.drawArrays(kind, 0, corners.length);
  }

  #attributes(buffer) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    for (const [index, size, offset] of [[0, 3, 0], [1, 2, 12], [2, 1, 20]]) {
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, size, this.gl.FLOAT, false, 24, offset);
    }
  }

  #paint(mode, color) {
    this.gl.uniform1i(this.place("mode"), mode);
    this.gl.uniform4fv(this.place("color"), color);
  }

  /** Turns the view by angles in radians, and moves it nearer by a factor. */
  move(turn, rise, near = 1) {
    this.turn += turn;
    this.rise = Math.max(-1.5, Math.min(1.5, this.rise + rise));
    this.near = Math.max(0.3, Math.min(12, this.near * near));
    this.draw();
  }

  look(view = {}) {
    Object.assign(this, HOME, view);
    this.draw();
  }

  #listen() {
    const { canvas } = this, fingers = new Map();
    const apart = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const wide = fingers.size === 2 ? apart() : 0;
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      if (fingers.size === 2) this.move(0, 0, apart() / wide);
      else this.move((event.clientX - before[0]) / 150, (event.clientY - before[1]) / 150);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    // The wheel scrolls the page unless the view has the focus.
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas) return;
      event.preventDefault();
      this.move(0, 0, Math.exp(-event.deltaY / 500));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1], "+": [0, 0, 1.15], "-": [0, 0, 1 / 1.15] };
      if (event.key !== "Home" && !steps[event.key]) return;
      event.preventDefault();
      if (steps[event.key]) this.move(...steps[event.key]);
      else this.look();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }
}

function link(gl) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error("the graphics driver refused the shaders");
  return program;
}

function elements(gl, indices) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
  return buffer;
}

/** Returns a function from deflections to slopes at the points, means over the triangles around. */
function gradients(x, y, triangles) {
  const area = new Float32Array(x.length);
  const twice = (a, b, c) => (x[b] - x[a]) * (y[c] - y[a]) - (x[c] - x[a]) * (y[b] - y[a]);
  for (let i = 0; i < triangles.length; i += 3) {
    const [a, b, c] = triangles.subarray(i, i + 3);
    for (const p of [a, b, c]) area[p] += Math.abs(twice(a, b, c));
  }
  return (w, slopes) => {
    slopes.fill(0);
    for (let i = 0; i < triangles.length; i += 3) {
      const a = triangles[i], b = triangles[i + 1], c = triangles[i + 2];
      const sign = Math.sign(twice(a, b, c));
      const gx = sign * ((w[b] - w[a]) * (y[c] - y[a]) - (w[c] - w[a]) * (y[b] - y[a]));
      const gy = sign * ((w[c] - w[a]) * (x[b] - x[a]) - (w[b] - w[a]) * (x[c] - x[a]));
      for (const p of [a, b, c]) { slopes[2 * p] += gx / area[p]; slopes[2 * p + 1] += gy / area[p]; }
    }
  };
}

/** Returns the matrix (by columns) and the eye of a camera that looks at the origin. */
function camera(turn, rise, distance, aspect) {
  const [st, ct, sr, cr] = [Math.sin(turn), Math.cos(turn), Math.sin(rise), Math.cos(rise)];
  const right = [ct, -st, 0], back = [-st * cr, -ct * cr, sr], up = [st * sr, ct * sr, cr];
  const f = 1 / TANGENT, far = distance, [n, m] = [0.05, 4 * far + 4];
  const depth = (n + m) / (n - m), shift = (2 * n * m) / (n - m);
  // Coordinates in front of the eye are -(back . p) + far.
  const matrix = [0, 1, 2].flatMap((i) => [(f / aspect) * right[i], f * up[i], depth * back[i], -back[i]]);
  matrix.push(0, 0, -depth * far + shift, far);
  return { matrix: new Float32Array(matrix), eye: back.map((v) => v * far) };
}
