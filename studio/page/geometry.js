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
 * Where faces have colours, each has three vertices of its own behind those of the points.
 * @param {Points} points @param {Triangulation} triangulation
 * @param {boolean} [isFlat]  Whether faces have colours in any case: the means of their vertices.
 * @returns {Geometry}
 */
export function geometryOf(points, { origins, twins }, isFlat = false) {
  const count = points.xs.length, { samples } = points;
  const faceSamples = points.faceSamples ?? (isFlat ? meansOf(points, origins) : undefined);
  const border = [], edges = [];
  for (let h = 0; h < origins.length; h++) {
    const to = h % 3 === 2 ? origins[h - 2] : origins[h + 1];
    if (twins[h] === NONE) border.push(h);
    if (twins[h] === NONE || h < twins[h]) edges.push(origins[h], to);
  }
  const all = count + 2 * border.length + (faceSamples ? origins.length : 0);
  const positions = new Float32Array(2 * all), values = new Uint16Array(4 * all);
  for (let v = 0; v < count; v++) {
    positions[2 * v] = points.xs[v];
    positions[2 * v + 1] = points.ys[v];
    putColor(points, samples, v, values, v);
  }
  const corners = faceSamples ? new Uint32Array(origins.length) : origins;
  if (faceSamples) {
    for (let h = 0; h < origins.length; h++) {
      const corner = all - origins.length + h;
      corners[h] = corner;
      positions[2 * corner] = points.xs[origins[h]];
      positions[2 * corner + 1] = points.ys[origins[h]];
      putColor(points, faceSamples, Math.floor(h / 3), values, corner);
    }
  }
  /** @type {number[]} */
  const rim = [];
  border.forEach((h, i) => {
    const ends = [corners[h], corners[h % 3 === 2 ? h - 2 : h + 1]], outer = count + 2 * i;
    for (const k of [0, 1]) {
      positions[2 * (outer + k)] = outward(positions[2 * ends[k]], points.width);
      positions[2 * (outer + k) + 1] = outward(positions[2 * ends[k] + 1], points.height);
      values.copyWithin(4 * (outer + k), 4 * ends[k], 4 * ends[k] + 4);
    }
    rim.push(ends[0], outer, ends[1], ends[1], outer, outer + 1);
  });
  const triangles = new Uint32Array(origins.length + rim.length);
  triangles.set(corners);
  triangles.set(rim, origins.length);
  const faceCount = origins.length / 3;
  return { vertexCount: count, faceCount, positions, values, triangles, edges: new Uint32Array(edges) };
}

/** The mean of the three vertices of each face. @param {Points} points @param {Uint32Array} origins */
function meansOf({ components, samples }, origins) {
  const means = new Uint16Array((origins.length / 3) * components);
  for (let f = 0; f < origins.length / 3; f++) {
    for (let c = 0; c < components; c++) {
      let sum = 0;
      for (let k = 0; k < 3; k++) sum += samples[origins[3 * f + k] * components + c];
      means[f * components + c] = Math.round(sum / 3);
    }
  }
  return means;
}

/** @param {number} at @param {number} side */
function outward(at, side) {
  return at === 0 ? -0.5 : at === side - 1 ? side - 0.5 : at;
}

/**
 * Writes a sample vector as red, green and blue, premultiplied, and alpha.
 * @param {Points} points @param {Uint16Array} samples @param {number} i
 * @param {Uint16Array} values @param {number} to
 */
function putColor({ components, precision }, samples, i, values, to) {
  const at = i * components, most = 2 ** precision - 1;
  const isColor = components >= 3;
  const hasAlpha = components === 2 || components === 4;
  const alpha = hasAlpha ? samples[at + components - 1] : most;
  for (let k = 0; k < 3; k++) {
    const straight = samples[at + (isColor ? k : 0)];
    values[4 * to + k] = Math.floor((2 * straight * alpha + most) / (2 * most));
  }
  values[4 * to + 3] = alpha;
}
