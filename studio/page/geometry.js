// A triangulation as the graphics card takes it.

/** @typedef {import("./pmesh.js").Points} Points */
/** @typedef {import("./triangulate.js").Triangulation} Triangulation */

/**
 * Lattice positions and samples of the vertices; triangles, the first `faceCount` of them those of
 * the mesh and the others a rim of half a pixel around it, so that the pixels of the border are
 * covered whole; and each edge once.
 * @typedef {object} Geometry
 * @property {number} vertexCount
 * @property {number} faceCount
 * @property {Float32Array} positions
 * @property {Uint16Array} values  Four for each vertex: red, green, blue, alpha.
 * @property {Uint32Array} triangles
 * @property {Uint32Array} edges
 */

const NONE = 0xffffffff;

/**
 * @param {Points} points @param {Triangulation} triangulation
 * @returns {Geometry}
 */
export function geometryOf(points, { origins, twins }) {
  const count = points.xs.length;
  const border = [], edges = [];
  for (let h = 0; h < origins.length; h++) {
    const to = h % 3 === 2 ? origins[h - 2] : origins[h + 1];
    if (twins[h] === NONE) border.push(origins[h], to);
    if (twins[h] === NONE || h < twins[h]) edges.push(origins[h], to);
  }
  const all = count + border.length;
  const positions = new Float32Array(2 * all), values = new Uint16Array(4 * all);
  for (let v = 0; v < count; v++) {
    positions[2 * v] = points.xs[v];
    positions[2 * v + 1] = points.ys[v];
    putColor(points, v, values, v);
  }
  const rim = [];
  for (let i = 0; i < border.length; i += 2) {
    const outer = count + i;
    for (const k of [0, 1]) {
      const v = border[i + k];
      positions[2 * (outer + k)] = outward(points.xs[v], points.width);
      positions[2 * (outer + k) + 1] = outward(points.ys[v], points.height);
      putColor(points, v, values, outer + k);
    }
    rim.push(border[i], outer, border[i + 1], border[i + 1], outer, outer + 1);
  }
  const triangles = new Uint32Array(origins.length + rim.length);
  triangles.set(origins);
  triangles.set(rim, origins.length);
  const faceCount = origins.length / 3;
  return { vertexCount: count, faceCount, positions, values, triangles, edges: new Uint32Array(edges) };
}

/** @param {number} at @param {number} side */
function outward(at, side) {
  return at === 0 ? -0.5 : at === side - 1 ? side - 0.5 : at;
}

/**
 * Writes the samples of a vertex as red, green, blue and alpha.
 * @param {Points} points @param {number} v @param {Uint16Array} values @param {number} to
 */
function putColor({ components, precision, samples }, v, values, to) {
  const at = v * components, most = 2 ** precision - 1;
  const isColor = components >= 3;
  for (let k = 0; k < 3; k++) values[4 * to + k] = samples[at + (isColor ? k : 0)];
  const hasAlpha = components === 2 || components === 4;
  values[4 * to + 3] = hasAlpha ? samples[at + components - 1] : most;
}
