// A brush for what matters: more vertices where one paints, fewer where one erases.

import { writtenPng } from "./png.js";

/** The level of pixels that nobody has painted. */
const PLAIN = 96;
/** The least level: black would not matter at all. */
const LEAST = 6;
/** Levels by which a stroke changes a pixel in its middle. */
const STRENGTH = 70;
/** The longer side of what is painted, at the most. */
const MOST_SIDE = 768;
const MOST_UNDO = 30;

export class Weights {
  /** @param {number} width @param {number} height  Of the picture. */
  constructor(width, height) {
    const scale = Math.min(1, MOST_SIDE / Math.max(width, height));
    this.scale = scale;
    this.width = Math.max(1, Math.round(width * scale));
    this.height = Math.max(1, Math.round(height * scale));
    this.full = { width, height };
    this.levels = new Uint8Array(this.width * this.height).fill(PLAIN);
    /** @type {Uint8Array<ArrayBuffer>[]} */
    this.before = [];
  }

  get isPlain() {
    return this.levels.every((level) => level === PLAIN);
  }

  /** Begins a stroke, which can be undone as a whole. */
  begin() {
    this.before.push(this.levels.slice());
    if (this.before.length > MOST_UNDO) this.before.shift();
  }

  /** Takes the last stroke back. */
  undo() {
    this.levels = this.before.pop() ?? this.levels;
  }

  clear() {
    this.begin();
    this.levels.fill(PLAIN);
  }

  /**
   * Paints from one place to another, softly towards the edge of the brush.
   * @param {{ x: number, y: number }} from @param {{ x: number, y: number }} to  From the lower left, in pixels of the picture.
   * @param {number} radius @param {boolean} erases
   */
  stroke(from, to, radius, erases) {
    const reach = Math.max(1, radius * this.scale), length = Math.hypot(to.x - from.x, to.y - from.y) * this.scale;
    const steps = Math.max(1, Math.ceil((3 * length) / reach));
    for (let i = 1; i <= steps; i++) {
      const x = (from.x + ((to.x - from.x) * i) / steps) * this.scale, y = (from.y + ((to.y - from.y) * i) / steps) * this.scale;
      this.dab(x, y, reach, ((erases ? -1 : 1) * STRENGTH) / Math.min(3, steps));
    }
  }

  /** @param {number} x @param {number} y @param {number} reach @param {number} strength */
  dab(x, y, reach, strength) {
    for (let row = Math.max(0, Math.floor(y - reach)); row <= Math.min(this.height - 1, y + reach); row++) {
      for (let column = Math.max(0, Math.floor(x - reach)); column <= Math.min(this.width - 1, x + reach); column++) {
        const distance = Math.hypot(column + 0.5 - x, row + 0.5 - y) / reach;
        if (distance >= 1) continue;
        const at = row * this.width + column;
        const level = this.levels[at] + strength * (1 - distance ** 2) ** 2;
        this.levels[at] = Math.min(255, Math.max(LEAST, level));
      }
    }
  }

  /** The weights as a picture of the size of the other one; null where nothing is painted. @returns {Promise<Blob | null>} */
  async picture() {
    if (this.isPlain) return null;
    const { width, height } = this.full;
    const rgba = new Uint8ClampedArray(4 * width * height).fill(255);
    for (let y = 0; y < height; y++) {
      // Rows of the picture from the top, those of the levels from the bottom.
      const row = Math.min(this.height - 1, Math.floor((height - 1 - y) * this.scale));
      for (let x = 0; x < width; x++) {
        const level = this.levels[row * this.width + Math.min(this.width - 1, Math.floor(x * this.scale))];
        rgba.fill(level, 4 * (y * width + x), 4 * (y * width + x) + 3);
      }
    }
    return writtenPng(width, height, rgba);
  }
}
