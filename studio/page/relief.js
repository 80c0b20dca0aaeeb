// The mesh in three dimensions, its luma as height, seen from an orbit.

import { bufferOf, compiled } from "./gl.js";
import { RELIEF } from "./shaders.js";

/** @typedef {import("./glb.js").Surface} Surface */
/**
 * A mesh in three dimensions, as it is seen and as it is taken away.
 * @typedef {object} Solid
 * @property {number} percent  Height between the darkest and the brightest, in percent of the longer side.
 * @property {boolean} invert  Whether dark is high.
 * @property {"image" | "hillshade" | "ramp" | "none"} color
 * @property {number} width  In millimetres, for printers.
 * @property {number} base  Thickness of the thinnest place in millimetres, for printers.
 */

/** @type {Readonly<Solid>} */
export const SOLID = Object.freeze({ percent: 10, invert: false, color: "image", width: 100, base: 1 });

/**
 * The service's parameters of a solid: lengths in pixels, or in millimetres for printers.
 * @param {Solid} solid @param {{ width: number, height: number, hasAlpha: boolean }} size @param {[number, number]} levels
 * @param {boolean} isPrinted
 * @returns {import("./api.js").Parameters}
 */
export function parametersOf(solid, size, [low, high], isPrinted) {
  const pixel = isPrinted ? solid.width / size.width : 1;
  const height = ((solid.percent / 100) * Math.max(size.width, size.height) * pixel) / (high - low);
  /** @type {import("./api.js").Parameters} */
  const parameters = { relief: "luma", height: height.toPrecision(6), invert_relief: String(solid.invert) };
  if (low > 0) parameters.z_offset = "min";
  if (size.hasAlpha) parameters.alpha = "cut";
  return isPrinted ? { ...parameters, width: String(solid.width), base: String(solid.base), unit: "mm" } : { ...parameters, color: solid.color };
}

const FIELD_OF_VIEW = 0.6;

export class Relief {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.program = compiled(gl, RELIEF);
    /** @type {WebGLVertexArrayObject | null} */
    this.array = null;
    this.count = 0;
    this.span = 1;
    this.middle = [0, 0, 0];
    /** Angles in radians: around the upright axis, and up from straight above. */
    this.turn = -0.5;
    this.tilt = 0.85;
    this.distance = 1.75;
    /** How much of the height of the surface. */
    this.stretch = 1;
  }

  /** Looks from where one looks at first. */
  reset() {
    [this.turn, this.tilt, this.distance] = [-0.5, 0.85, 1.75];
  }

  /** Shows nothing. */
  clear() {
    this.count = 0;
  }

  /** @param {Surface} surface */
  set({ positions, colors, triangles }) {
    const { gl } = this;
    if (this.array) gl.deleteVertexArray(this.array);
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    bufferOf(gl, gl.ARRAY_BUFFER, positions);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    bufferOf(gl, gl.ARRAY_BUFFER, colors);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.FLOAT, false, 0, 0);
    bufferOf(gl, gl.ELEMENT_ARRAY_BUFFER, triangles);
    gl.bindVertexArray(null);
    this.count = triangles.length;
    const [low, high] = bounds(positions);
    this.middle = low.map((least, k) => (least + high[k]) / 2);
    this.span = Math.max(high[0] - low[0], high[1] - low[1], 1e-9);
  }

  /** @param {number} dx @param {number} dy  In pixels of the page. */
  orbit(dx, dy) {
    this.turn += dx * 0.006;
    this.tilt = Math.min(1.5, Math.max(0, this.tilt + dy * 0.006));
  }

  /** @param {number} factor */
  approach(factor) {
    this.distance = Math.min(6, Math.max(0.4, this.distance / factor));
  }

  /** @param {number} width @param {number} height */
  draw(width, height) {
    const { gl, program: { program, uniforms } } = this;
    if (!this.array || !this.count) return;
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.camera, false, this.camera(width / height));
    gl.uniform3fv(uniforms.middle, this.middle);
    gl.uniform1f(uniforms.stretch, this.stretch);
    gl.bindVertexArray(this.array);
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
    gl.disable(gl.DEPTH_TEST);
  }

  /** From the surface to clip space, column by column. @param {number} aspect */
  camera(aspect) {
    const { turn, tilt } = this;
    const away = this.distance * this.span * Math.max(1, 1.1 / aspect);
    const [ct, st, cp, sp] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
    // Turned around z, then tilted around x, then moved away.
    const view = [
      [ct, -st, 0, 0],
      [st * cp, ct * cp, sp, 0],
      [-st * sp, -ct * sp, cp, -away],
    ];
    const focal = 1 / Math.tan(FIELD_OF_VIEW / 2), near = away * 0.02, far = away * 4;
    const depth = (far + near) / (near - far), shift = (2 * far * near) / (near - far);
    const rows = [
      view[0].map((value) => (value * focal) / aspect),
      view[1].map((value) => value * focal),
      view[2].map((value, k) => value * depth + (k === 3 ? shift : 0)),
      view[2].map((value) => -value),
    ];
    return Float32Array.from([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
  }
}

/** @param {Float32Array} positions */
function bounds(positions) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i++) {
    low[i % 3] = Math.min(low[i % 3], positions[i]);
    high[i % 3] = Math.max(high[i % 3], positions[i]);
  }
  return [low, high];
}
