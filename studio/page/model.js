// MODEL, the mesh as text: width, height, components and precision, then OFF.

/** @typedef {import("./pmesh.js").Points} Points */

/** The comment before those with the samples of the faces. */
const FACE_SAMPLES = /^# face samples: \d+$/m;

/**
 * The points in the file's order, with the file's faces: they need not follow from the points.
 * @param {string} text
 * @returns {Points & { faces: Uint32Array }}
 */
export function readModel(text) {
  const comments = text.split(FACE_SAMPLES)[1];
  const faceSamples = comments && Uint16Array.from(comments.replaceAll("#", "").trim().split(/\s+/), Number);
  const numbers = text
    .replace(/#.*/g, "")
    .split(/\s+/)
    .filter((word) => word !== "" && word !== "OFF")
    .map(Number);
  const [width, height, components, precision, vertexCount, faceCount] = numbers;
  const each = 2 + components;
  let at = 7;
  const xs = new Int32Array(vertexCount), ys = new Int32Array(vertexCount);
  const samples = new Uint16Array(vertexCount * components);
  for (let v = 0; v < vertexCount; v++, at += each) {
    xs[v] = numbers[at];
    ys[v] = numbers[at + 1];
    for (let c = 0; c < components; c++) samples[v * components + c] = numbers[at + 2 + c];
  }
  const faces = new Uint32Array(3 * faceCount);
  for (let f = 0; f < faceCount; f++, at += 4) {
    for (let k = 0; k < 3; k++) faces[3 * f + k] = numbers[at + 1 + k];
  }
  const mesh = { width, height, components, precision, xs, ys, samples, ranks: null, squaredErrors: null, faces };
  return faceSamples ? { ...mesh, faceSamples } : mesh;
}

/**
 * The opposite half-edge of each half-edge of faces.
 * @param {Uint32Array} origins
 * @returns {import("./triangulate.js").Triangulation}
 */
export function withTwins(origins) {
  const twins = new Uint32Array(origins.length).fill(0xffffffff);
  /** @type {Map<number, number>} */
  const known = new Map();
  const most = origins.length;
  for (let h = 0; h < most; h++) {
    const to = h % 3 === 2 ? origins[h - 2] : origins[h + 1];
    const twin = known.get(to * most + origins[h]);
    if (twin === undefined) {
      known.set(origins[h] * most + to, h);
    } else {
      twins[h] = twin;
      twins[twin] = h;
    }
  }
  return { origins, twins };
}
