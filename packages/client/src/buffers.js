// Points to the buffers that a GPU draws, the same as those of the library in Rust.

import { prefix } from "./pmesh.js";
import { triangulate } from "./triangulate.js";

/** @typedef {import("./pmesh.js").Points} Points */

/**
 * Vertex and index buffers. Where the faces have colours, each has three vertices of its own.
 * @typedef {object} Buffers
 * @property {Float32Array} positions  x, y and 0 for each vertex in pixels; y grows upwards
 * @property {Uint8Array} colors  Red, green, blue and alpha for each vertex, as the picture encodes them
 * @property {Float32Array} uvs  Coordinates in the picture as a texture, 0 to 1; v grows downwards
 * @property {Uint32Array} indices  Three vertices for each face, counter-clockwise
 */

/**
 * Three vertices for each face, counter-clockwise: those of the file, or those that follow from the points.
 * @param {Points} points
 * @returns {Uint32Array}
 */
export function facesOf(points) {
  return points.faces ?? triangulate(points.xs, points.ys).origins;
}

/**
 * The buffers of a mesh, or of the mesh of its `size` most important vertices.
 *
 * ```js
 * const { positions, colors, indices } = buffersOf(await readPmesh(file), 500);
 * geometry.setAttribute("position", new BufferAttribute(positions, 3));
 * geometry.setAttribute("color", new BufferAttribute(colors, 4, true));
 * geometry.setIndex(new BufferAttribute(indices, 1));
 * ```
 * @param {Points} points @param {number} [size]  4 at least; fewer than all need a progression
 * @returns {Buffers}
 */
export function buffersOf(points, size = points.xs.length) {
  if (!(size >= 4) || (size < points.xs.length && !points.ranks)) {
    throw new RangeError(`there is no mesh of ${size} vertices: ask for format=progression, and for 4 vertices at least`);
  }
  const { width, height, components, precision, xs, ys, samples, faceSamples, ...shown } = prefix(points, size);
  const faces = facesOf({ width, height, components, precision, xs, ys, samples, ...shown });
  const count = faceSamples ? faces.length : xs.length;
  const positions = new Float32Array(3 * count), uvs = new Float32Array(2 * count);
  const colors = new Uint8Array(4 * count);
  const most = 2 ** precision - 1;
  for (let i = 0; i < count; i++) {
    const v = faceSamples ? faces[i] : i;
    positions.set([xs[v], ys[v]], 3 * i);
    uvs.set([(xs[v] + 0.5) / width, (height - ys[v] - 0.5) / height], 2 * i);
    const at = components * (faceSamples ? Math.floor(i / 3) : v);
    const of = (/** @type {number} */ c) => Math.floor((510 * (faceSamples ?? samples)[at + c] + most) / (2 * most));
    const isGray = components < 3;
    const alpha = components === 2 ? of(1) : components === 4 ? of(3) : 255;
    colors.set([of(0), of(isGray ? 0 : 1), of(isGray ? 0 : 2), alpha], 4 * i);
  }
  return { positions, colors, uvs, indices: faceSamples ? Uint32Array.from({ length: count }, (_, i) => i) : faces };
}
