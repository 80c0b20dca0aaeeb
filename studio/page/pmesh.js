// pmesh: a mesh or a whole progression of meshes in one small file. The service's documentation of
// the format is that of its reader; this one reads the same bytes.

/**
 * Points of a picture by row, then column, with their samples, vertex by vertex. Rows count from
 * the bottom. The rank of a vertex is its place in the order of importance: the vertices of ranks
 * below n are the mesh of n vertices. Without ranks there is one mesh only.
 * @typedef {object} Points
 * @property {number} width
 * @property {number} height
 * @property {number} components
 * @property {number} precision
 * @property {Int32Array} xs
 * @property {Int32Array} ys
 * @property {Uint16Array} samples
 * @property {Uint32Array | null} ranks
 * @property {Float64Array | null} squaredErrors  Of each size from 4 up, where there are ranks.
 * @property {Uint32Array} [faces]  Where they do not follow from the points.
 * @property {Uint16Array} [faceSamples]  Of each face, where each has one colour.
 */

const HEADER_BYTES = 24;
const COMPACT_VERSION = 3;
/** Of a progression of an elevation model. */
const TERRAIN_VERSION = 4;
/** More than any service takes by default. */
const MOST_PIXELS = 2 ** 28;
const STRIPS = 2;
const LEAST_STRIP = 4;

/**
 * @param {ArrayBuffer} buffer
 * @returns {Promise<Points>}
 */
export async function readPmesh(buffer) {
  const header = new DataView(buffer);
  const isPmesh = header.getUint32(0) === 0x504d5348, version = header.getUint8(4), kept = header.getUint8(5);
  if (isPmesh && version === COMPACT_VERSION) {
    // With the first such mesh: a visit begins with a progression.
    const { readCompact } = await import("./compact.js");
    return readCompact(buffer, MOST_PIXELS);
  }
  if (!isPmesh || (version !== 1 && version !== TERRAIN_VERSION) || kept > 1) {
    throw new Error("The service sent a mesh that this page cannot read.");
  }
  // Of an elevation model a text follows the header.
  const textBytes = version === TERRAIN_VERSION ? 2 + header.getUint16(HEADER_BYTES, true) : 0;
  const isOrdered = kept === 1;
  const precision = header.getUint8(6), components = header.getUint8(7);
  const width = header.getUint32(8, true), height = header.getUint32(12, true);
  const count = header.getUint32(16, true);
  const bytes = await inflated(buffer.slice(HEADER_BYTES + textBytes));
  const { xs, ys, end } = readPlaces(bytes, count, width);
  const planes = components * (precision > 8 ? 2 : 1);
  const differences = bytes.subarray(end, end + planes * count);
  const samples = readSamples({ width, height, components, precision }, xs, ys, differences);
  const order = bytes.subarray(end + planes * count);
  const ranks = isOrdered ? readRanks(order, count) : null;
  const squaredErrors = isOrdered ? readErrors(order, 4 * count, count) : null;
  return { width, height, components, precision, xs, ys, samples, ranks, squaredErrors };
}

/** @param {ArrayBuffer} deflated */
async function inflated(deflated) {
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** A number in groups of seven bits, from the lowest. @param {Uint8Array} bytes @param {number} at */
function readNumber(bytes, at) {
  let number = 0, weight = 1, byte;
  do {
    byte = bytes[at++];
    number += (byte & 0x7f) * weight;
    weight *= 128;
  } while (byte >= 0x80);
  return { number, end: at };
}

/** @param {Uint8Array} bytes @param {number} count @param {number} width */
function readPlaces(bytes, count, width) {
  const xs = new Int32Array(count), ys = new Int32Array(count);
  let end = 0, next = 0;
  for (let v = 0; v < count; v++) {
    const gap = readNumber(bytes, end);
    end = gap.end;
    const place = next + gap.number;
    xs[v] = place % width;
    ys[v] = Math.floor(place / width);
    next = place + 1;
  }
  return { xs, ys, end };
}

/**
 * @param {{ width: number, height: number, components: number, precision: number }} shape
 * @param {Int32Array} xs @param {Int32Array} ys @param {Uint8Array} differences
 */
function readSamples(shape, xs, ys, differences) {
  const { components, precision } = shape;
  const count = xs.length, modulus = 2 ** precision, isWide = precision > 8;
  const samples = new Uint16Array(count * components);
  const predictor = new Predictor(shape, xs, ys);
  for (let v = 0; v < count; v++) {
    const nearest = predictor.nearest(v);
    for (let c = 0; c < components; c++) {
      const at = (isWide ? 2 * c : c) * count + v;
      const folded = isWide ? differences[at] | (differences[at + count] << 8) : differences[at];
      const half = Math.ceil(folded / 2) % modulus;
      const difference = folded % 2 === 0 ? half : modulus - half;
      let expected = 0;
      if (nearest >= 0) {
        expected = samples[nearest * components + c];
        if (c > 0) {
          const rise = samples[v * components] - samples[nearest * components];
          expected = (expected + modulus + rise) % modulus;
        }
      }
      samples[v * components + c] = (expected + difference) % modulus;
    }
  }
  return samples;
}

/** Tells for each vertex the one before it that its samples are predicted by. */
class Predictor {
  /**
   * @param {{ width: number, height: number }} shape
   * @param {Int32Array} xs @param {Int32Array} ys
   */
  constructor({ width, height }, xs, ys) {
    const area = Math.floor((width * height) / Math.max(xs.length, 1));
    this.strip = Math.max(Math.floor(Math.sqrt(area)), LEAST_STRIP);
    this.last = new Int32Array(Math.floor(width / this.strip) + 1).fill(-1);
    this.xs = xs;
    this.ys = ys;
  }

  /** The nearest vertex among those kept around vertex v, -1 for none. @param {number} v */
  nearest(v) {
    const { xs, ys, last } = this;
    const at = Math.floor(xs[v] / this.strip);
    let best = -1, least = Infinity;
    for (let i = Math.max(at - STRIPS, 0); i < Math.min(at + STRIPS + 1, last.length); i++) {
      const w = last[i];
      if (w < 0) continue;
      const distance = (xs[w] - xs[v]) ** 2 + (ys[w] - ys[v]) ** 2;
      if (distance < least || (distance === least && w < best)) [best, least] = [w, distance];
    }
    last[at] = v;
    return best;
  }
}

/** @param {Uint8Array} bytes @param {number} count */
function readRanks(bytes, count) {
  const ranks = new Uint32Array(count);
  for (let v = 0; v < count; v++) {
    ranks[v] = bytes[v] + bytes[count + v] * 2 ** 8 + bytes[2 * count + v] * 2 ** 16 + bytes[3 * count + v] * 2 ** 24;
  }
  return ranks;
}

/**
 * The error of the smallest mesh, and by how much each vertex lowers it.
 * @param {Uint8Array} bytes @param {number} at @param {number} count
 */
function readErrors(bytes, at, count) {
  const errors = new Float64Array(count - 3);
  let { number: error, end } = readNumber(bytes, at);
  errors[0] = error;
  for (let size = 5; size <= count; size++) {
    const folded = readNumber(bytes, end);
    end = folded.end;
    error -= folded.number % 2 === 0 ? folded.number / 2 : -(folded.number + 1) / 2;
    errors[size - 4] = error;
  }
  return errors;
}

/**
 * The PSNR in decibels of the mesh of a size: infinite for a perfect copy.
 * @param {Points} points @param {number} size
 */
export function psnrOf({ width, height, components, precision, squaredErrors }, size) {
  const error = squaredErrors?.[size - 4] ?? NaN;
  return 10 * Math.log10(((2 ** precision - 1) ** 2 * width * height * components) / error);
}

/**
 * The points of the n lowest ranks.
 * @param {Points} points @param {number} n
 * @returns {Points}
 */
export function prefix(points, n) {
  const { ranks, components } = points;
  if (!ranks || n >= points.xs.length) return points;
  const xs = new Int32Array(n), ys = new Int32Array(n);
  const samples = new Uint16Array(n * components);
  let at = 0;
  for (let v = 0; v < ranks.length; v++) {
    if (ranks[v] >= n) continue;
    xs[at] = points.xs[v];
    ys[at] = points.ys[v];
    for (let c = 0; c < components; c++) samples[at * components + c] = points.samples[v * components + c];
    at++;
  }
  return { ...points, xs, ys, samples, ranks: null, squaredErrors: null };
}
