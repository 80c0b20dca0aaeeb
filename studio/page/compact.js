// The compact version of pmesh: docs/pmesh.md says how it is coded. All numbers are whole, and each
// operation gives what the service's does.

import { triangulate } from "./triangulate.js";

/** @typedef {import("./pmesh.js").Points} Points */

const HEADER_BYTES = 8;
const EXACT = 8, MOST_STEP = 2 ** 19;
const DAMAGED = "The mesh is damaged.";

/** Reads a mesh. @param {ArrayBuffer} buffer @param {number} mostPixels @returns {Points} */
export function readCompact(buffer, mostPixels) {
  const bytes = new Uint8Array(buffer);
  const isFlat = (bytes[5] & 1) === 1, precision = bytes[6], components = bytes[7];
  let at = HEADER_BYTES;
  const number = () => {
    let sum = 0, weight = 1, byte;
    do {
      if (at >= bytes.length || weight > 2 ** 28) throw new Error(DAMAGED);
      byte = bytes[at++];
      sum += (byte & 0x7f) * weight;
      weight *= 128;
    } while (byte >= 0x80);
    return sum;
  };
  const width = number(), height = number(), count = number();
  const isPossible = bytes[5] <= 3 && precision >= 1 && precision <= 16 && components >= 1 && width >= 2
    && height >= 2 && width * height <= mostPixels && count >= 4 && count <= width * height;
  if (!isPossible) throw new Error(DAMAGED);
  const steps = Array.from({ length: components }, number);
  if (steps.some((step) => step < EXACT || step > MOST_STEP)) throw new Error(DAMAGED);
  // The text of an elevation model.
  if (bytes[5] & 2) at += 2 + bytes[at] + 256 * bytes[at + 1];
  const coder = new Decoder(bytes.subarray(at));
  const { xs, ys } = readPlaces(coder, width, height, count);
  const { origins } = triangulate(xs, ys);
  const values = new Values(coder, components, count + (isFlat ? origins.length / 3 : 0));
  const faces = isFlat ? orderedFaces(origins) : origins;
  readVertices(values, xs, ys, origins);
  if (isFlat) readFaces(values, count, faces);
  if (coder.at < coder.bytes.length) throw new Error(DAMAGED);
  const all = samplesOf(values.numbers, steps, 2 ** precision - 1);
  /** @type {Points} */
  const points = { width, height, components, precision, xs, ys, samples: all.subarray(0, count * components), ranks: null, squaredErrors: null };
  return isFlat ? { ...points, faces, faceSamples: all.subarray(count * components) } : points;
}

/** Decisions from an arithmetic code. */
class Decoder {
  /** @param {Uint8Array} bytes */
  constructor(bytes) {
    this.bytes = bytes;
    this.at = this.low = this.number = 0;
    this.high = 0xffffffff;
    for (let i = 0; i < 4; i++) this.shift();
  }

  shift() {
    // A code may end up to four zeros early.
    if (this.at >= this.bytes.length + 4) throw new Error(DAMAGED);
    this.number = ((this.number << 8) | (this.bytes[this.at++] ?? 0)) >>> 0;
  }

  /** Whether what is true with a probability of chance / 4096 is so. @param {number} chance */
  decide(chance) {
    const range = this.high - this.low;
    const middle = this.low + (range >>> 12) * chance + (((range & 0xfff) * chance) >>> 12);
    const decision = this.number <= middle;
    if (decision) this.high = middle;
    else this.low = middle + 1;
    while ((this.low ^ this.high) >>> 24 === 0) {
      this.low = (this.low << 8) >>> 0;
      this.high = ((this.high << 8) | 0xff) >>> 0;
      this.shift();
    }
    return decision;
  }
}

/** 4096 / (1 + exp(-x / 256)) at x = -2048, -1920, ..., 2048. */
const LOGISTIC = [
  1, 2, 4, 6, 10, 17, 27, 45, 74, 120, 194, 311, 488, 747, 1102, 1546, 2048, 2550, 2994, 3349, 3608,
  3785, 3902, 3976, 4022, 4051, 4069, 4079, 4086, 4090, 4092, 4094, 4095,
];
const MOST_ODDS = 2047, FIRST_WEIGHT = 14000, MOST_WEIGHT = 2 ** 20, LEARNING = 10, MOST_MET = 255;

/** The probability, of 4096, of logarithmic odds in 256ths. @param {number} odds */
function probability(odds) {
  const place = odds + 2048, at = place >> 7, part = place & 127;
  return (LOGISTIC[at] * (128 - part) + LOGISTIC[at + 1] * part + 64) >> 7;
}

/** For each probability of 4096 the least odds that have it or a larger one. */
const ODDS = new Int16Array(4096);
for (let chance = 0, odds = -MOST_ODDS; chance < 4096; chance++) {
  while (odds < MOST_ODDS && probability(odds) < chance) odds++;
  ODDS[chance] = odds;
}

/** By the decisions that a context met: how far it is trusted and how fast it follows, of 65536. */
const TRUST = Int32Array.from({ length: MOST_MET + 1 }, (_, met) => Math.floor((65536 * met) / (met + 2)));
const RATE = Int32Array.from({ length: MOST_MET + 1 }, (_, met) => Math.floor(65536 / (met + 2)));

/** Contexts of several inputs, and the weights of their mixtures. */
class Mixture {
  /** @param {Decoder} coder @param {number[]} sizes @param {number} sets */
  constructor(coder, sizes, sets) {
    this.coder = coder;
    this.chances = sizes.map((size) => new Uint16Array(size).fill(2 ** 15));
    this.met = sizes.map((size) => new Uint8Array(size));
    this.weights = new Int32Array(sets * sizes.length).fill(FIRST_WEIGHT);
    this.odds = new Int32Array(sizes.length);
    this.contexts = new Int32Array(sizes.length);
  }

  /** Decides in `contexts` with a set of weights. @param {number} set */
  decide(set) {
    const { chances, met, weights, odds, contexts } = this;
    const inputs = contexts.length, first = set * inputs;
    let sum = 0;
    for (let i = 0; i < inputs; i++) {
      const context = contexts[i];
      odds[i] = (ODDS[chances[i][context] >> 4] * TRUST[met[i][context]]) >> 16;
      sum += odds[i] * weights[first + i];
    }
    const mean = Math.floor(sum / 65536);
    const chance = probability(Math.min(Math.max(mean, -MOST_ODDS), MOST_ODDS));
    const decision = this.coder.decide(chance);
    const error = ((decision ? 4096 : 0) - chance) * LEARNING;
    const target = decision ? 65535 : 0;
    for (let i = 0; i < inputs; i++) {
      const weight = weights[first + i] + ((odds[i] * error + 8192) >> 14);
      weights[first + i] = Math.min(Math.max(weight, -MOST_WEIGHT), MOST_WEIGHT);
      const context = contexts[i], known = chances[i], count = met[i][context];
      known[context] += ((target - known[context]) * RATE[count]) >> 16;
      if (count < MOST_MET) met[i][context]++;
    }
    return decision;
  }
}

const SIZES = 15, SIBLINGS = 15;

/** Which cells of 2^size columns and rows are occupied. */
class Grid {
  /** @param {number} width @param {number} height @param {number} size */
  constructor(width, height, size) {
    this.width = ((width - 1) >> size) + 1;
    this.height = ((height - 1) >> size) + 1;
    // A bit for each column from -3 on, and two bytes more than there are columns.
    this.stride = (this.width >> 3) + 3;
    this.bytes = new Uint8Array(this.stride * this.height);
  }

  /** A bit for each of the columns x - 3 to x + 4 of a row, where it is occupied. @param {number} x @param {number} y */
  around(x, y) {
    if (y < 0 || y >= this.height) return 0;
    const at = y * this.stride + (x >> 3);
    return ((this.bytes[at] | (this.bytes[at + 1] << 8)) >> (x & 7)) & 255;
  }

  /** @param {number} x @param {number} y */
  at(x, y) {
    return (this.around(x, y) >> 3) & 1;
  }

  /** @param {number} x @param {number} y */
  occupy(x, y) {
    const bit = x + 3;
    this.bytes[y * this.stride + (bit >> 3)] |= 1 << (bit & 7);
  }

  /** Whether a cell holds a corner of the picture, or is the last of four and the others are empty. @param {number} x @param {number} y */
  isKnown(x, y) {
    const endsRow = x === this.width - 1, endsColumn = y === this.height - 1;
    if ((x === 0 || endsRow) && (y === 0 || endsColumn)) return true;
    if (!(x & 1 || endsRow) || !(y & 1 || endsColumn)) return false;
    const left = x & ~1, low = y & ~1;
    return this.at(left, low) + this.at(left + 1, low) + this.at(left, low + 1) === 0;
  }
}

/** @param {Decoder} coder @param {number} width @param {number} height @param {number} count */
function readPlaces(coder, width, height, count) {
  const inputs = [SIZES * SIBLINGS * 16, 3 * SIBLINGS * 256, SIBLINGS * 4096, SIZES * SIBLINGS * 49, SIZES * SIBLINGS, SIZES * SIBLINGS * 1024];
  const mixture = new Mixture(coder, inputs, SIZES * 4);
  const sizes = 32 - Math.clz32(Math.max(width, height) - 1);
  let parents = new Grid(width, height, sizes);
  parents.occupy(0, 0);
  let xs = new Int32Array(1), ys = new Int32Array(1);
  for (let size = sizes - 1; size >= 0; size--) {
    const cells = new Grid(width, height, size);
    const nextXs = new Int32Array(Math.min(count, 4 * xs.length)), nextYs = new Int32Array(nextXs.length);
    let found = 0;
    for (let from = 0, to; from < xs.length; from = to) {
      for (to = from + 1; to < xs.length && ys[to] === ys[from];) to++;
      for (let y = 2 * ys[from]; y < Math.min(2 * ys[from] + 2, cells.height); y++) {
        for (let i = from; i < to; i++) {
          for (let x = 2 * xs[i]; x < Math.min(2 * xs[i] + 2, cells.width); x++) {
            if (!cells.isKnown(x, y) && !mixture.decide(setContexts(mixture.contexts, cells, parents, size, x, y))) continue;
            if (found === count) throw new Error(DAMAGED);
            cells.occupy(x, y);
            nextXs[found] = x;
            nextYs[found++] = y;
          }
        }
      }
    }
    parents = cells;
    xs = nextXs.slice(0, found);
    ys = nextYs.slice(0, found);
  }
  if (xs.length !== count) throw new Error(DAMAGED);
  return { xs, ys };
}

/**
 * Sets the contexts of a cell, and returns its set of weights.
 * @param {Int32Array} contexts @param {Grid} cells @param {Grid} parents
 * @param {number} size @param {number} x @param {number} y
 */
function setContexts(contexts, cells, parents, size, x, y) {
  const px = x >> 1, py = y >> 1, place = (x & 1) | ((y & 1) << 1);
  // Rows from that of the cell downwards, and from that below the parent upwards; bit 3 is its column.
  const a = cells.around(x, y), b = cells.around(x, y - 1), c = cells.around(x, y - 2), d = cells.around(x, y - 3);
  const e = parents.around(px, py - 1), f = parents.around(px, py), g = parents.around(px, py + 1), h = parents.around(px, py + 2);
  const west = (a >> 2) & 1, south = (b >> 3) & 1, southWest = (b >> 2) & 1, southEast = (b >> 4) & 1;
  const siblings = place === 0 ? 0 : place === 1 ? 1 + west
    : place === 2 ? 3 + south + 2 * southEast : 7 + west + 2 * south + 4 * southWest;
  const around = west | (south << 1) | (southWest << 2) | (southEast << 3);
  const farther = ((a >> 1) & 1) | (((c >> 3) & 1) << 1) | (((b >> 1) & 1) << 2) | (((b >> 5) & 1) << 3)
    | (((c >> 2) & 1) << 4) | (((c >> 4) & 1) << 5) | ((a & 1) << 6) | (((d >> 3) & 1) << 7);
  const east = (f >> 4) & 1, north = (g >> 3) & 1, northEast = (g >> 4) & 1, northWest = (g >> 2) & 1;
  const parentsAround = ((f >> 2) & 1) | (east << 1) | (((e >> 3) & 1) << 2) | (north << 3)
    | (((e >> 2) & 1) << 4) | (((e >> 4) & 1) << 5) | (northWest << 6) | (northEast << 7);
  const parentsAhead = ((f >> 5) & 1) | (((h >> 3) & 1) << 1) | (east << 2) | (north << 3) | (northEast << 4) | (northWest << 5);
  const before = ONES[a & 7] + ONES[b & 127] + ONES[c & 127] + ONES[d & 127];
  const ahead = ONES[f & 48] + ONES[g & 62] + ONES[h & 62];
  const level = Math.min(size, SIZES - 1), sized = level * SIBLINGS + siblings;
  contexts[0] = sized * 16 + around;
  contexts[1] = (Math.min(level, 2) * SIBLINGS + siblings) * 256 + parentsAround;
  contexts[2] = siblings * 4096 + ((farther << 4) | around);
  contexts[3] = sized * 49 + 7 * countClass(before) + countClass(ahead);
  contexts[4] = sized;
  contexts[5] = sized * 1024 + ((around << 6) | parentsAhead);
  return level * 4 + place;
}

/** How many bits of a number are 1. */
const ONES = Uint8Array.from({ length: 128 }, (_, number) => number.toString(2).replaceAll("0", "").length);

/** How many of ascending numbers a number reaches. @param {number[]} least @param {number} number */
const reached = (least, number) => {
  let count = 0;
  while (count < least.length && number >= least[count]) count++;
  return count;
};

const COUNTS = [1, 2, 3, 5, 8, 13], MAGNITUDES = [1, 2, 3, 5, 8, 12, 18, 28, 44, 71];
/** @param {number} number */
const countClass = (number) => reached(COUNTS, number);
/** @param {number} number */
const magnitudeClass = (number) => reached(MAGNITUDES, Math.abs(number));
/** @param {number} number */
const signedClass = (number) => {
  const bits = Math.min(32 - Math.clz32(Math.abs(number)), 6);
  return number < 0 ? 6 - bits : 6 + bits;
};

const UNARY = 18, BITS = 18, SIZE_AT = 2 + UNARY, BITS_AT = SIZE_AT + BITS, DECISIONS = BITS_AT + BITS;
const SIGNED = 13, UNSIGNED = 11, DISTANCES = 8, PREDICTIONS = 64;
const MOST = 2 ** 18, MOST_DISTANCE = 65535, KINDS = 4;
const INPUTS = [UNSIGNED * UNSIGNED, DISTANCES * UNSIGNED, SIGNED * SIGNED, SIGNED * SIGNED, 1, UNSIGNED * UNSIGNED, PREDICTIONS * SIGNED];

/** Numbers of nodes, predicted from neighbours that are known. */
class Values {
  /** @param {Decoder} coder @param {number} components @param {number} nodes */
  constructor(coder, components, nodes) {
    this.coder = coder;
    this.components = components;
    this.numbers = new Int32Array(nodes * components);
    this.differences = new Int32Array(nodes * components);
    this.bases = new Int32Array(INPUTS.length);
    /** @type {Mixture[]} */
    this.mixtures = [];
    this.begin();
  }

  /** Forgets what was learnt. */
  begin() {
    const sizes = INPUTS.map((size) => size * DECISIONS);
    const kinds = Math.min(this.components, KINDS);
    this.mixtures = Array.from({ length: kinds }, () => new Mixture(this.coder, sizes, DECISIONS));
  }

  /** Reads a node's numbers. @param {number} node @param {{ distance: number, node: number }[]} near */
  read(node, near) {
    near.sort((a, b) => a.distance - b.distance || a.node - b.node);
    const { components, numbers, differences } = this;
    for (let c = 0; c < components; c++) {
      const predicted = this.setBases(node * components, c, near);
      const difference = this.difference(this.mixtures[Math.min(c, KINDS - 1)]);
      const number = predicted + difference;
      if (Math.abs(number) > MOST) throw new Error(DAMAGED);
      numbers[node * components + c] = number;
      differences[node * components + c] = difference;
    }
  }

  /**
   * Sets the contexts of a component, and returns what is predicted.
   * @param {number} at @param {number} c @param {{ distance: number, node: number }[]} near
   */
  setBases(at, c, near) {
    const { components, numbers, differences, bases } = this;
    let sum = 0, weights = 0, least = Infinity, most = -Infinity, activity = 0;
    for (const { distance, node } of near) {
      const number = numbers[node * components + c], weight = Math.min(distance, MOST_DISTANCE);
      sum += weight * number;
      weights += weight;
      least = Math.min(least, number);
      most = Math.max(most, number);
      activity += Math.abs(differences[node * components + c]);
    }
    const n = near.length;
    const predicted = n === 0 ? 0 : Math.floor((2 * sum + weights) / (2 * weights));
    if (n === 0) least = most = 0;
    const nearest = [0, 1].map((i) => (i < n ? numbers[near[i].node * components + c] - predicted : 0));
    const before = c > 0 ? differences[at] : 0;
    const beside = c > 1 ? differences[at + 1] : c === 0 && n > 0 ? differences[near[0].node * components] : 0;
    const mean = n === 0 ? 0 : Math.floor((2 * activity + n - 1) / n);
    const distance = n === 0 ? MOST_DISTANCE : near[0].distance;
    const spread = n > 1 ? most - least : 2;
    bases[0] = magnitudeClass(mean) * UNSIGNED + magnitudeClass(before);
    bases[1] = Math.min(32 - Math.clz32(distance), DISTANCES - 1) * UNSIGNED + magnitudeClass(c === 0 ? spread : before);
    bases[2] = signedClass(nearest[0]) * SIGNED + signedClass(nearest[1]);
    bases[3] = signedClass(before) * SIGNED + signedClass(beside);
    bases[5] = magnitudeClass(Math.max(most - predicted, 0)) * UNSIGNED + magnitudeClass(Math.max(predicted - least, 0));
    bases[6] = (Math.min(Math.max(predicted, -PREDICTIONS / 2), PREDICTIONS / 2 - 1) + PREDICTIONS / 2) * SIGNED + signedClass(before);
    return predicted;
  }

  /** @param {Mixture} mixture */
  difference(mixture) {
    const decide = (/** @type {number} */ at) => {
      for (let i = 0; i < INPUTS.length; i++) mixture.contexts[i] = this.bases[i] * DECISIONS + at;
      return mixture.decide(at);
    };
    if (decide(0)) return 0;
    const isNegative = decide(1);
    let size = 0;
    while (size < UNARY && decide(2 + size)) size++;
    let magnitude = 1 + size;
    if (size === UNARY) {
      let bits = 0, number = 1;
      while (bits < BITS && decide(SIZE_AT + bits)) bits++;
      while (bits-- > 0) number = number * 2 + (decide(BITS_AT + bits) ? 1 : 0);
      magnitude += number - 1;
    }
    return isNegative ? -magnitude : magnitude;
  }
}

/**
 * Reads the numbers of vertices: neighbours are those before a vertex that share an edge with it.
 * @param {Values} values @param {Int32Array} xs @param {Int32Array} ys @param {Uint32Array} faces
 */
function readVertices(values, xs, ys, faces) {
  /** @type {Set<number>[]} */
  const before = Array.from(xs, () => new Set());
  for (let i = 0; i < faces.length; i++) {
    const a = faces[i], b = faces[i % 3 === 2 ? i - 2 : i + 1];
    before[Math.max(a, b)].add(Math.min(a, b));
  }
  before.forEach((others, v) => {
    values.read(v, Array.from(others, (node) => ({ distance: (xs[v] - xs[node]) ** 2 + (ys[v] - ys[node]) ** 2, node })));
  });
}

/** Faces that begin with their first vertex, in ascending order. @param {Uint32Array} faces */
function orderedFaces(faces) {
  const all = [];
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = faces.subarray(i, i + 3), least = Math.min(a, b, c);
    all.push(a === least ? [a, b, c] : b === least ? [b, c, a] : [c, a, b]);
  }
  all.sort((p, q) => p[0] - q[0] || p[1] - q[1] || p[2] - q[2]);
  return Uint32Array.from(all.flat());
}

/**
 * Reads the numbers of faces: neighbours are the vertices, and the faces before that share an edge.
 * @param {Values} values @param {number} count @param {Uint32Array} faces
 */
function readFaces(values, count, faces) {
  values.begin();
  /** The face at each edge so far. @type {Map<string, number>} */
  const open = new Map();
  for (let i = 0; i < faces.length; i += 3) {
    const corners = Array.from(faces.subarray(i, i + 3)), node = count + i / 3;
    const edges = corners.map((a, side) => [a, corners[(side + 1) % 3]].sort((p, q) => p - q).join());
    const near = [...corners, ...edges.flatMap((edge) => open.get(edge) ?? [])];
    values.read(node, near.map((other) => ({ distance: 1, node: other })));
    for (const edge of edges) open.set(edge, node);
  }
}

/** Samples of numbers of steps. @param {Int32Array} numbers @param {number[]} steps @param {number} largest */
function samplesOf(numbers, steps, largest) {
  const samples = new Uint16Array(numbers.length), components = steps.length;
  for (let i = 0; i < numbers.length; i += components) {
    const vector = steps.map((step, c) => Math.floor((numbers[i + c] * step + EXACT / 2) / EXACT));
    if (components === 3 || components === 4) {
      const middle = vector[0] - Math.floor(vector[2] / 2), blue = middle - Math.floor(vector[1] / 2);
      [vector[0], vector[1], vector[2]] = [blue + vector[1], vector[2] + middle, blue];
    }
    vector.forEach((value, c) => (samples[i + c] = Math.min(Math.max(value, 0), largest)));
  }
  return samples;
}
