// Points to their preferred-directions Delaunay triangulation, by a line that sweeps the rows
// upwards: as the service does it, so that the faces are the same. Borut Zalik, "An efficient
// sweep-line Delaunay triangulation algorithm", 2005; C. L. Lawson, "Software for C1 surface
// interpolation", 1977.

import { inCircle, orientation } from "./predicates.js";

const NONE = 0xffffffff;

/** @param {number} h */
const next = (h) => (h % 3 === 2 ? h - 2 : h + 1);
/** @param {number} h */
const previous = (h) => (h % 3 === 0 ? h + 2 : h - 1);

/**
 * Triangles in threes of vertices, counter-clockwise with y up, and the opposite of each half-edge
 * (half-edge h goes from `origins[h]` to the next vertex of its triangle; NONE at the border).
 * @typedef {{ origins: Uint32Array, twins: Uint32Array }} Triangulation
 */

/**
 * Triangulates distinct lattice points given by row, then column, which hold the corners of a
 * rectangle that begins at the origin.
 * @param {Int32Array} xs @param {Int32Array} ys
 * @returns {Triangulation}
 */
export function triangulate(xs, ys) {
  const sweep = new Sweep(xs, ys);
  let vertex = 0;
  while (ys[vertex] === 0) vertex++;
  for (; vertex < xs.length; vertex++) sweep.insert(vertex);
  sweep.fillAll();
  return sweep.finish();
}

/** What is triangulated of the rows behind the line. */
class Sweep {
  /** @param {Int32Array} xs @param {Int32Array} ys */
  constructor(xs, ys) {
    this.xs = xs;
    this.ys = ys;
    const width = xs[xs.length - 1] + 1;
    this.outer = 6 * xs.length;
    this.side = this.outer + width;
    this.origins = new Uint32Array(this.outer);
    this.twins = new Uint32Array(this.outer + width + 1).fill(NONE);
    this.length = 0;
    /** @type {number[]} */
    this.suspects = [];
    // The front, the upper boundary: at most one vertex in each column.
    this.vertices = new Uint32Array(width);
    this.lefts = new Uint32Array(width).fill(NONE);
    this.rights = new Uint32Array(width).fill(NONE);
    this.columns = new Uint32Array((width >> 5) + 1);
    let last = NONE;
    for (let v = 0; ys[v] === 0; v++) {
      this.insertAfter(last, xs[v], v);
      this.link(this.outer + xs[v], this.side);
      last = xs[v];
    }
  }

  /** The nearest column with a vertex, not after this one. @param {number} column */
  atOrBefore(column) {
    let word = column >> 5;
    let bits = this.columns[word] & (0xffffffff >>> (31 - (column & 31)));
    while (bits === 0) bits = this.columns[--word];
    return (word << 5) + 31 - Math.clz32(bits);
  }

  /** @param {number} left @param {number} column @param {number} vertex */
  insertAfter(left, column, vertex) {
    const right = left === NONE ? NONE : this.rights[left];
    this.vertices[column] = vertex;
    this.lefts[column] = left;
    this.rights[column] = right;
    if (left !== NONE) this.rights[left] = column;
    if (right !== NONE) this.lefts[right] = column;
    this.columns[column >> 5] |= 1 << (column & 31);
  }

  /** @param {number} a @param {number} b @param {number} c */
  add(a, b, c) {
    const h = this.length;
    this.origins[h] = a;
    this.origins[h + 1] = b;
    this.origins[h + 2] = c;
    this.length += 3;
    return h;
  }

  /** @param {number} h @param {number} twin */
  link(h, twin) {
    this.twins[h] = twin;
    this.twins[twin] = h;
  }

  /** The half-edge beneath the front's edge from a column to the next. @param {number} column */
  beneath(column) {
    return this.twins[this.outer + column];
  }

  /** Connects the next point to the front. @param {number} vertex */
  insert(vertex) {
    const column = this.xs[vertex];
    const beneath = this.atOrBefore(column);
    if (beneath < column) this.insertOverEdge(vertex, column, beneath);
    else this.insertOverVertex(vertex, column);
    this.fillNarrow(column, this.rights, false);
    this.fillNarrow(column, this.lefts, true);
  }

  /** @param {number} vertex @param {number} column @param {number} left */
  insertOverEdge(vertex, column, left) {
    const base = this.add(this.vertices[left], this.vertices[this.rights[left]], vertex);
    this.link(base, this.beneath(left));
    this.link(base + 1, this.outer + column);
    this.link(base + 2, this.outer + left);
    this.insertAfter(left, column, vertex);
    this.suspects.push(base);
    this.legalize();
  }

  /** @param {number} vertex @param {number} column */
  insertOverVertex(vertex, column) {
    const { outer, side, lefts, rights, vertices, suspects } = this;
    const beneath = vertices[column], left = lefts[column], right = rights[column];
    let upright = side;
    if (left !== NONE) {
      const base = this.add(vertices[left], beneath, vertex);
      this.link(base, this.beneath(left));
      this.link(base + 1, side);
      this.link(base + 2, outer + left);
      upright = base + 1;
      suspects.push(base);
    }
    if (right !== NONE) {
      const base = this.add(beneath, vertices[right], vertex);
      this.link(base, this.beneath(column));
      this.link(base + 1, outer + column);
      this.link(base + 2, upright);
      suspects.push(base, base + 2);
    }
    vertices[column] = vertex;
    this.legalize();
  }

  /**
   * Fills pockets at one side of a vertex while they are narrow.
   * @param {number} column @param {Uint32Array} toward @param {boolean} isLeft
   */
  fillNarrow(column, toward, isLeft) {
    for (;;) {
      const bottom = toward[column];
      if (bottom === NONE) return;
      const far = toward[bottom];
      if (far === NONE) return;
      const [left, right] = isLeft ? [far, column] : [column, far];
      if (!this.isNarrow(left, bottom, right)) return;
      this.fill(left, bottom, right);
    }
  }

  /**
   * Whether the front turns at its vertex in the column `bottom` by under 108 degrees.
   * @param {number} left @param {number} bottom @param {number} right
   */
  isNarrow(left, bottom, right) {
    const { xs, ys, vertices } = this;
    const l = vertices[left], b = vertices[bottom], r = vertices[right];
    const lx = xs[l] - xs[b], ly = ys[l] - ys[b], rx = xs[r] - xs[b], ry = ys[r] - ys[b];
    const sine = rx * ly - ry * lx, cosine = lx * rx + ly * ry;
    return sine > 0 && 3 * cosine + sine > 0;
  }

  /** @param {number} left @param {number} bottom @param {number} right */
  fill(left, bottom, right) {
    const { vertices } = this;
    const base = this.add(vertices[left], vertices[bottom], vertices[right]);
    this.link(base, this.beneath(left));
    this.link(base + 1, this.beneath(bottom));
    this.link(base + 2, this.outer + left);
    this.rights[left] = right;
    this.lefts[right] = left;
    this.columns[bottom >> 5] &= ~(1 << (bottom & 31));
    this.suspects.push(base, base + 1);
    this.legalize();
  }

  /** Fills all pockets, so that the front becomes the row of the upper corners. */
  fillAll() {
    const { xs, ys, vertices, lefts, rights } = this;
    let left = 0;
    for (;;) {
      const bottom = rights[left];
      if (bottom === NONE) return;
      const right = rights[bottom];
      if (right === NONE) return;
      const a = vertices[left], b = vertices[bottom], c = vertices[right];
      if (orientation(xs[a], ys[a], xs[b], ys[b], xs[c], ys[c]) > 0) {
        this.fill(left, bottom, right);
        if (lefts[left] !== NONE) left = lefts[left];
      } else {
        left = bottom;
      }
    }
  }

  /** Flips what must be among the suspected edges. */
  legalize() {
    const { suspects, twins } = this;
    for (let h = suspects.pop(); h !== undefined; h = suspects.pop()) {
      const twin = twins[h];
      if (this.isToFlip(h, twin)) {
        this.flip(h, twin);
        suspects.push(h, next(h), twin, next(twin));
      }
    }
  }

  /** @param {number} h @param {number} twin */
  isToFlip(h, twin) {
    if (h >= this.outer || twin >= this.outer) return false;
    const { xs, ys, origins } = this;
    const a = origins[h], b = origins[next(h)], c = origins[previous(h)], d = origins[previous(twin)];
    return inCircle(xs[a], ys[a], xs[b], ys[b], xs[c], ys[c], xs[d], ys[d]);
  }

  /** @param {number} h @param {number} twin */
  flip(h, twin) {
    const { origins, twins } = this;
    const fromC = previous(h), fromD = previous(twin);
    const beyondCA = twins[fromC], beyondDB = twins[fromD];
    origins[h] = origins[fromD];
    this.link(h, beyondDB);
    origins[twin] = origins[fromC];
    this.link(twin, beyondCA);
    this.link(fromC, fromD);
  }

  /** @returns {Triangulation} */
  finish() {
    const twins = this.twins.subarray(0, this.length);
    for (let h = 0; h < twins.length; h++) if (twins[h] >= this.outer) twins[h] = NONE;
    return { origins: this.origins.subarray(0, this.length), twins };
  }
}
