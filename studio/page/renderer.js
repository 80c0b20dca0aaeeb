// Draws pictures and meshes into one canvas.
//
// A mesh at rest is first drawn at the picture's own size into a texture, in the picture's own
// values: what the service's PNG of it holds. That texture is then shown at any zoom; edges and
// points are drawn over it at the screen's resolution. While sizes change, a mesh of a large picture
// is drawn to the screen alone, so that a frame costs the screen's pixels and not the picture's.

import { bufferOf, compiled, textureOf } from "./gl.js";
import { channels } from "./looks.js";
import { Relief } from "./relief.js";
import { EDGES, MARKS, MESH, PICTURE } from "./shaders.js";

/** @typedef {import("./geometry.js").Geometry} Geometry */
/**
 * What is to be seen.
 * @typedef {object} Scene
 * @property {"mesh" | "original" | "density" | "error" | "none"} layer
 * @property {boolean} wireframe
 * @property {boolean} points
 * @property {boolean} smooth  Triangles at the screen's resolution instead of pixels.
 * @property {number | null} split  How much of each pane, from the left, shows the original.
 * @property {number} errorScale  Levels of 255 at the end of the scale.
 * @property {number} zoom  Pixels of the page for a pixel of the picture.
 * @property {number} x  What is in the middle, in pixels from the picture's lower left corner.
 * @property {number} y
 * @property {number} paneCount  1, or 2 side by side.
 * @property {boolean} relief
 * @property {boolean} moves  Whether sizes change: large pictures are drawn to the screen alone.
 * @property {boolean} brush  Whether the weights are seen.
 * @property {import("./looks.js").Look} look
 */
/** @typedef {import("./picture.js").Bitmap} Bitmap */
/**
 * A mesh on the graphics card, and the picture that it models.
 * @typedef {object} Drawn
 * @property {Geometry} geometry
 * @property {number} most
 * @property {WebGLVertexArrayObject} array
 * @property {(WebGLBuffer | null)[]} buffers
 * @property {boolean} isPictured  Whether its picture is drawn.
 * @property {WebGLVertexArrayObject | null} edges  For edges of a width.
 */

const LAYERS = { mesh: 0, original: 1, density: 2, error: 3, none: 4, ground: 5 };
/** Pixels of a picture up to which it is drawn as a whole for each size. */
const SMALL_PICTURE = 1_500_000;
/** Pixels that are shown of a picture, at the most: four bytes each, in the page and on the graphics card. */
export const MOST_SHOWN = 40_000_000;

export class Renderer {
  /** @param {HTMLCanvasElement} canvas @param {() => void} onRestored */
  constructor(canvas, onRestored) {
    this.canvas = canvas;
    const options = { antialias: true, alpha: true, powerPreference: /** @type {const} */ ("high-performance") };
    const gl = /** @type {WebGL2RenderingContext | null} */ (canvas.getContext("webgl2", options));
    if (!gl) throw new Error("This browser cannot draw with WebGL 2. Turn hardware acceleration on, or use a current browser.");
    this.gl = gl;
    this.width = 1;
    this.height = 1;
    /** The levels shown as black and white, 0 to 1. @type {[number, number]} */
    this.levels = [0, 1];
    this.hasAlpha = false;
    this.hasDensity = false;
    /** JavaScript's part of the last frame, in milliseconds. */
    this.frameMs = 0;
    /** @type {(Drawn | null)[]} */
    this.meshes = [null, null];
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.begin();
      onRestored();
    });
    this.begin();
  }

  begin() {
    const { gl } = this;
    this.meshProgram = compiled(gl, MESH);
    this.marksProgram = compiled(gl, MARKS);
    this.edgesProgram = compiled(gl, EDGES);
    this.pictureProgram = compiled(gl, PICTURE);
    this.empty = gl.createVertexArray();
    this.original = textureOf(gl, 1, 1, new Uint8Array([14, 17, 23, 255]));
    this.density = textureOf(gl, 1, 1, new Uint8Array([0]), true);
    this.weights = textureOf(gl, 1, 1, new Uint8Array([96]), true);
    this.targets = [this.target(1, 1), this.target(1, 1)];
    this.meshes = [null, null];
    this.relief = new Relief(gl);
  }

  /** @param {number} width @param {number} height */
  target(width, height) {
    const { gl } = this;
    const texture = textureOf(gl, width, height, null);
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.generateMipmap(gl.TEXTURE_2D);
    return { texture, framebuffer };
  }

  /** The largest side that a picture may have here. */
  get maxSide() {
    return /** @type {number} */ (this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE));
  }

  /** Shows a picture, in the place of one of the same size or for another. @param {Bitmap} bitmap */
  setOriginal({ width, height, rgba, fullWidth, fullHeight }) {
    const { gl } = this;
    if (fullWidth !== this.width || fullHeight !== this.height) this.setSize(fullWidth, fullHeight);
    gl.deleteTexture(this.original ?? null);
    this.original = textureOf(gl, width, height, rgba);
  }

  /** Begins with a picture of this size that is not there. @param {number} width @param {number} height */
  setSize(width, height) {
    const { gl } = this;
    this.width = width;
    this.height = height;
    for (const { texture, framebuffer } of this.targets ?? []) {
      gl.deleteTexture(texture);
      gl.deleteFramebuffer(framebuffer);
    }
    const scale = Math.min(1, this.maxSide / Math.max(width, height), Math.sqrt(MOST_SHOWN / (width * height)));
    this.targetSize = [Math.max(1, Math.floor(width * scale)), Math.max(1, Math.floor(height * scale))];
    this.targets = [this.target(this.targetSize[0], this.targetSize[1]), this.target(1, 1)];
    this.hasSecond = this.hasDensity = false;
    for (const side of [0, 1]) this.clearMesh(side);
    gl.deleteTexture(this.original ?? null);
    this.original = textureOf(gl, 1, 1, new Uint8Array([14, 17, 23, 255]));
    gl.deleteTexture(this.density ?? null);
    this.density = textureOf(gl, 1, 1, new Uint8Array([0]), true);
  }

  /** @param {Uint8Array} map @param {number} width @param {number} height */
  setDensity(map, width, height) {
    const { gl } = this;
    gl.deleteTexture(this.density ?? null);
    this.density = textureOf(gl, width, height, map, true);
    this.hasDensity = true;
  }

  /** @param {{ levels: Uint8Array, width: number, height: number }} weights */
  setWeights({ levels, width, height }) {
    const { gl } = this;
    gl.deleteTexture(this.weights ?? null);
    this.weights = textureOf(gl, width, height, levels, true);
  }

  /** @param {number} side */
  clearMesh(side) {
    const drawn = this.meshes[side];
    if (drawn) {
      this.gl.deleteVertexArray(drawn.array);
      drawn.buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
    }
    this.meshes[side] = null;
  }

  /**
   * Puts a mesh in the place of one, and draws its picture.
   * @param {number} side @param {Geometry} geometry @param {number} precision
   */
  setMesh(side, geometry, precision) {
    const { gl } = this;
    this.clearMesh(side);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [bufferOf(gl, gl.ARRAY_BUFFER, geometry.positions)];
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    buffers.push(bufferOf(gl, gl.ARRAY_BUFFER, geometry.values));
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.UNSIGNED_SHORT, false, 0, 0);
    const indices = new Uint32Array(geometry.triangles.length + geometry.edges.length);
    indices.set(geometry.triangles);
    indices.set(geometry.edges, geometry.triangles.length);
    buffers.push(bufferOf(gl, gl.ELEMENT_ARRAY_BUFFER, indices));
    gl.bindVertexArray(null);
    this.meshes[side] = { geometry, most: 2 ** precision - 1, array, buffers, isPictured: false, edges: null };
  }

  /** Draws the picture that a mesh models, at its own size. @param {number} side */
  drawPicture(side) {
    const { gl, targets, width, height } = this;
    const drawn = this.meshes[side];
    if (!drawn || !targets || drawn.isPictured) return;
    drawn.isPictured = true;
    const [columns, rows] = this.targetSize ?? [1, 1];
    // The second picture is only there where two are compared.
    if (side === 1 && !this.hasSecond) targets[1] = this.target(columns, rows);
    this.hasSecond ||= side === 1;
    gl.bindFramebuffer(gl.FRAMEBUFFER, targets[side].framebuffer);
    gl.viewport(0, 0, columns, rows);
    gl.disable(gl.BLEND);
    gl.disable(gl.SCISSOR_TEST);
    this.drawTriangles(drawn, [2 / width, 2 / height, -1, -1], true);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.bindTexture(gl.TEXTURE_2D, targets[side].texture);
    gl.generateMipmap(gl.TEXTURE_2D);
  }

  /** @param {Drawn} drawn @param {number[]} place @param {boolean} rounds */
  drawTriangles(drawn, place, rounds) {
    const { gl } = this;
    const { program, uniforms } = /** @type {import("./gl.js").Program} */ (this.meshProgram);
    gl.useProgram(program);
    gl.uniform4fv(uniforms.place, place);
    gl.uniform1f(uniforms.most, drawn.most);
    gl.uniform1i(uniforms.rounds, Number(rounds));
    gl.uniform2fv(uniforms.levels, this.levels);
    gl.bindVertexArray(drawn.array);
    gl.drawElements(gl.TRIANGLES, drawn.geometry.triangles.length, gl.UNSIGNED_INT, 0);
  }

  /** The picture that a mesh models: four bytes a pixel, rows from the bottom. @param {number} side */
  readPicture(side) {
    const { gl, targets } = this;
    const [width, height] = this.targetSize ?? [1, 1];
    const pixels = new Uint8Array(width * height * 4);
    if (!targets) return pixels;
    this.drawPicture(side);
    gl.bindFramebuffer(gl.FRAMEBUFFER, targets[side].framebuffer);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pixels;
  }

  /** Draws a frame. @param {Scene} scene */
  draw(scene) {
    const began = performance.now();
    const { gl, canvas } = this;
    const ratio = globalThis.devicePixelRatio || 1;
    const width = Math.max(Math.round(canvas.clientWidth * ratio), 1);
    const height = Math.max(Math.round(canvas.clientHeight * ratio), 1);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    for (let side = 0; side < scene.paneCount; side++) if (!this.isDirect(scene)) this.drawPicture(side);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (scene.relief) {
      this.relief?.draw(width, height);
    } else {
      gl.enable(gl.SCISSOR_TEST);
      for (let side = 0; side < scene.paneCount; side++) {
        const left = Math.round((side * width) / scene.paneCount);
        const right = Math.round(((side + 1) * width) / scene.paneCount) - (side + 1 < scene.paneCount ? 2 : 0);
        this.drawPane(scene, side, left, right - left, height, ratio);
      }
    }
    this.frameMs = performance.now() - began;
  }

  /** Whether triangles are drawn to the screen alone, without the picture that they model. @param {Scene} scene */
  isDirect({ layer, relief, smooth, moves }) {
    const isLarge = this.width * this.height > SMALL_PICTURE;
    return relief || (layer === "mesh" ? smooth || (moves && isLarge) : layer !== "error");
  }

  /**
   * @param {Scene} scene @param {number} side @param {number} left @param {number} width
   * @param {number} height @param {number} ratio
   */
  drawPane(scene, side, left, width, height, ratio) {
    const { gl } = this;
    gl.viewport(left, 0, width, height);
    const scale = scene.zoom * ratio;
    // Whole pixels, so that a picture at its own size is seen as it is.
    const originX = Math.round(width / 2 - scene.x * scale), originY = Math.round(height / 2 - scene.y * scale);
    const place = [(2 * scale) / width, (2 * scale) / height, (2 * originX) / width - 1, (2 * originY) / height - 1];
    const cut = scene.split === null ? 0 : Math.round(scene.split * width);
    if (cut > 0) {
      gl.scissor(left, 0, cut, height);
      this.drawRectangle("original", side, place, scale, scene);
    }
    if (cut >= width) return;
    gl.scissor(left + cut, 0, width - cut, height);
    const drawn = this.meshes[side];
    if (drawn && scene.layer === "mesh" && this.isDirect(scene)) {
      this.drawRectangle("ground", side, place, scale, scene);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      this.drawTriangles(drawn, place, false);
      gl.disable(gl.BLEND);
    } else {
      // Before there is a mesh, the picture itself is seen.
      const layer = !drawn && (scene.layer === "mesh" || scene.layer === "error") ? "original" : scene.layer;
      this.drawRectangle(layer, side, place, scale, scene);
    }
    if (!drawn) return;
    if (scene.layer === "mesh" && scene.look.edges > 0) this.drawEdges(drawn, place, scale, scene.look, [width, height]);
    this.drawMarks(scene, drawn, place, scale, ratio);
  }

  /** Draws edges of a width in pixels of the picture. @param {Drawn} drawn @param {number[]} place @param {number} scale @param {import("./looks.js").Look} look @param {number[]} size  Of what is drawn into. */
  drawEdges(drawn, place, scale, look, size) {
    const { gl } = this;
    const { program, uniforms } = /** @type {import("./gl.js").Program} */ (this.edgesProgram);
    drawn.edges ??= this.edgesOf(drawn);
    gl.useProgram(program);
    gl.bindVertexArray(drawn.edges);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniform4fv(uniforms.place, place);
    gl.uniform2fv(uniforms.size, size);
    gl.uniform1f(uniforms.width, Math.max(1, look.edges * scale));
    gl.uniform3fv(uniforms.tint, channels(look.edgeColor).map((level) => level / 255));
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, drawn.geometry.edges.length / 2);
    gl.disable(gl.BLEND);
  }

  /** Both ends of each edge, for one strip of two triangles. @param {Drawn} drawn */
  edgesOf({ geometry: { edges, positions }, buffers }) {
    const { gl } = this;
    const ends = new Float32Array(2 * edges.length);
    for (let i = 0; i < edges.length; i++) ends.set(positions.subarray(2 * edges[i], 2 * edges[i] + 2), 2 * i);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    buffers.push(bufferOf(gl, gl.ARRAY_BUFFER, ends));
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.FLOAT, false, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindVertexArray(null);
    return array;
  }

  /**
   * Paints a mesh that is not on the stage.
   * @param {Geometry} geometry @param {number} most @param {number} scale @param {import("./looks.js").Look} look
   * @param {CanvasRenderingContext2D} context
   */
  paint(geometry, most, scale, look, context) {
    const kept = this.meshes[1];
    this.meshes[1] = null;
    this.setMesh(1, geometry, Math.log2(most + 1));
    for (const { from, rows, width, height, pixels } of this.bands(1, scale, { ...look, background: look.background || "#000000" })) {
      context.putImageData(upright(pixels, width, rows), 0, height - from - rows);
    }
    this.clearMesh(1);
    this.meshes[1] = kept;
  }

  /**
   * The mesh as it looks, drawn sharp at any scale, in bands from the bottom: four bytes a pixel, rows from the bottom.
   * @param {number} side @param {number} scale @param {import("./looks.js").Look} look
   * @returns {Generator<{ from: number, rows: number, width: number, height: number, pixels: Uint8ClampedArray }>}
   */
  *bands(side, scale, look) {
    const { gl } = this;
    const drawn = this.meshes[side];
    const width = Math.round(this.width * scale), height = Math.round(this.height * scale);
    if (!drawn) return;
    const most = Math.max(16, Math.min(height, Math.floor(4_000_000 / width)));
    for (let from = 0; from < height; from += most) {
      const rows = Math.min(most, height - from);
      const target = this.target(width, rows);
      const samples = gl.createFramebuffer(), stored = gl.createRenderbuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, samples);
      gl.bindRenderbuffer(gl.RENDERBUFFER, stored);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, Math.min(4, gl.getParameter(gl.MAX_SAMPLES)), gl.RGBA8, width, rows);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, stored);
      gl.viewport(0, 0, width, rows);
      gl.disable(gl.SCISSOR_TEST);
      gl.disable(gl.BLEND);
      const ground = look.background ? channels(look.background).map((level) => level / 255) : null;
      gl.clearColor(ground?.[0] ?? 0, ground?.[1] ?? 0, ground?.[2] ?? 0, ground ? 1 : 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      const place = [(2 * scale) / width, (2 * scale) / rows, -1, -1 - (2 * from) / rows];
      if (ground) gl.enable(gl.BLEND);
      gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      this.drawTriangles(drawn, place, false);
      gl.disable(gl.BLEND);
      if (look.edges > 0) this.drawEdges(drawn, place, scale, look, [width, rows]);
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, samples);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, target.framebuffer);
      gl.blitFramebuffer(0, 0, width, rows, 0, 0, width, rows, gl.COLOR_BUFFER_BIT, gl.NEAREST);
      gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
      const pixels = new Uint8ClampedArray(4 * width * rows);
      gl.readPixels(0, 0, width, rows, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.deleteFramebuffer(samples);
      gl.deleteRenderbuffer(stored);
      gl.deleteFramebuffer(target.framebuffer);
      gl.deleteTexture(target.texture);
      yield { from, rows, width, height, pixels };
    }
  }

  /**
   * @param {keyof typeof LAYERS} layer @param {number} side @param {number[]} place @param {number} scale
   * @param {Scene} scene
   */
  drawRectangle(layer, side, place, scale, { errorScale, look, brush }) {
    const { gl, targets, original, density, weights } = this;
    const { program, uniforms } = /** @type {import("./gl.js").Program} */ (this.pictureProgram);
    gl.disable(gl.BLEND);
    gl.useProgram(program);
    gl.bindVertexArray(this.empty ?? null);
    const textures = { mesh: targets?.[side].texture, original, density, weights };
    Object.entries(textures).forEach(([name, texture], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture ?? null);
      gl.uniform1i(uniforms[name], unit);
    });
    gl.activeTexture(gl.TEXTURE0);
    gl.uniform4fv(uniforms.place, place);
    gl.uniform2f(uniforms.size, this.width, this.height);
    gl.uniform1i(uniforms.layer, LAYERS[layer]);
    gl.uniform1f(uniforms.errorScale, errorScale);
    gl.uniform1f(uniforms.pixelSide, scale);
    gl.uniform1i(uniforms.brush, Number(brush && layer !== "ground"));
    const ground = look.background ? channels(look.background) : null;
    gl.uniform4f(uniforms.ground, (ground?.[0] ?? 0) / 255, (ground?.[1] ?? 0) / 255, (ground?.[2] ?? 0) / 255, ground ? 1 : 0);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /**
   * Draws edges and points, fainter where they are so dense that they would hide the picture.
   * @param {Scene} scene @param {Drawn} drawn @param {number[]} place @param {number} scale
   * @param {number} ratio
   */
  drawMarks(scene, drawn, place, scale, ratio) {
    // Lines alone are the edges themselves.
    const showsEdges = scene.wireframe || scene.layer === "none";
    if (!showsEdges && !scene.points) return;
    const { gl } = this;
    const { program, uniforms } = /** @type {import("./gl.js").Program} */ (this.marksProgram);
    const { geometry } = drawn;
    const spacing = scale * Math.sqrt((this.width * this.height) / geometry.vertexCount);
    gl.useProgram(program);
    gl.bindVertexArray(drawn.array);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniform4fv(uniforms.place, place);
    gl.uniform1f(uniforms.most, drawn.most);
    gl.uniform1f(uniforms.ownColor, scene.layer === "none" ? 1 : 0);
    if (showsEdges) {
      const strength = scene.layer === "none" ? 0.95 : 0.62;
      gl.uniform1f(uniforms.strength, strength * Math.min(1, Math.max(0.16, spacing / (14 * ratio))));
      gl.uniform1i(uniforms.isPoint, 0);
      gl.drawElements(gl.LINES, geometry.edges.length, gl.UNSIGNED_INT, 4 * geometry.triangles.length);
    }
    if (scene.points) {
      gl.uniform1f(uniforms.strength, 1);
      gl.uniform1i(uniforms.isPoint, 1);
      gl.uniform1f(uniforms.pointSize, Math.min(11 * ratio, Math.max(2.5 * ratio, spacing * 0.45)));
      gl.drawArrays(gl.POINTS, 0, geometry.vertexCount);
    }
    gl.disable(gl.BLEND);
  }
}

/** Rows from the bottom as a canvas takes them. @param {Uint8ClampedArray} pixels @param {number} width @param {number} rows */
export function upright(pixels, width, rows) {
  const image = new ImageData(width, rows), each = 4 * width;
  for (let row = 0; row < rows; row++) image.data.set(pixels.subarray(row * each, (row + 1) * each), (rows - 1 - row) * each);
  return image;
}
