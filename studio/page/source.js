// The picture that is meshed: its file, what the browser sees in it, and the job that the service
// keeps it with, so that it is sent once.

import { MOST_SHOWN } from "./renderer.js";

/** @typedef {import("./picture.js").Bitmap} Bitmap */
/** @typedef {import("./decode.js").Nature} Nature */
/** @typedef {import("./picture.js").Picture} Picture */

export class Source {
  /** @param {string} name @param {Blob | null} file @param {string | null} sample */
  constructor(name, file, sample) {
    this.name = name;
    /** The file; null where only its job is known. */
    this.file = file;
    this.sample = sample;
    /** @type {Bitmap | null} */
    this.bitmap = null;
    /** @type {Nature | null} */
    this.nature = null;
    /** How many pixels it has, 0 where nobody knows. */
    this.pixels = Promise.resolve(0);
    /** What the browser sees is known then. @type {Promise<unknown>} */
    this.looked = Promise.resolve();
    /** The samples as the service reads them. @type {Picture | null} */
    this.picture = null;
    /** The levels shown as black and as white. @type {[number, number]} */
    this.levels = [0, 1];
    /** The job that keeps the file at the service. @type {string | null} */
    this.job = null;
    /** A picture of the weights of the pixels. @type {Blob | null} */
    this.weights = null;
  }

  /** Whether the original can be had again for another mesh. */
  get isThere() {
    return this.file !== null || this.job !== null;
  }
}

/** Workers that decode files and paint our own pictures. */
export class Helpers {
  constructor() {
    this.decoder = new Worker(new URL("decode-worker.js", import.meta.url), { type: "module" });
    this.painter = new Worker(new URL("sample-worker.js", import.meta.url), { type: "module" });
    /** @type {Map<string, (value: any) => void>} */
    this.waiting = new Map();
    this.count = 0;
    this.decoder.onmessage = this.painter.onmessage = ({ data }) => {
      this.waiting.get(data.id)?.(data);
      this.waiting.delete(data.id);
    };
  }

  /** @param {Worker} worker @param {object} message @returns {Promise<any>} */
  ask(worker, message) {
    const id = String(++this.count);
    worker.postMessage({ ...message, id });
    return new Promise((resolve) => this.waiting.set(id, resolve));
  }

  /** Finds out what the browser sees in a file. @param {Source} source @param {number} maxSide */
  async look(source, maxSide) {
    const { bitmap, nature } = await this.ask(this.decoder, { file: source.file, maxSide, maxPixels: MOST_SHOWN });
    Object.assign(source, { bitmap, nature });
  }

  /** Paints one of our pictures. @param {string} name @param {number} width @param {number} height @returns {Promise<Blob>} */
  async painted(name, width, height) {
    return (await this.ask(this.painter, { name, width, height })).blob;
  }

  /** The picture's outcomes, small. @param {Bitmap} bitmap @returns {Promise<Record<string, ImageBitmap>>} */
  async thumbnails(bitmap) {
    return (await this.ask(this.painter, { thumbnailsOf: bitmap })).images;
  }
}
