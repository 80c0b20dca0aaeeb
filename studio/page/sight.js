// The first sight of a picture, while it is decoded beside the page: at once the thumbnail that
// cameras put into their files, and the picture as soon as the browser has it.

import { byId } from "./dom.js";

/** Bytes of a file in which its thumbnail is. */
const HEAD = 1 << 17;

export class FirstSight {
  constructor() {
    this.image = byId("first-sight", HTMLImageElement);
    /** The address of the file that is shown; empty for none. */
    this.url = "";
    /** Ends the wait for the picture's size. @type {(pixels: number) => void} */
    this.tell = () => {};
  }

  /** Whether there is something to be seen. */
  get isThere() {
    return this.url !== "";
  }

  /**
   * Shows a file, and returns the number of its pixels: 0 where it is hidden before, or of no format that browsers know.
   * @param {Blob} file @returns {Promise<number>}
   */
  show(file) {
    this.hide();
    const url = (this.url = URL.createObjectURL(file));
    return new Promise((resolve) => {
      this.tell = resolve;
      this.load(file, url).then(resolve, () => resolve(0));
    });
  }

  /** @param {Blob} file @param {string} url  Of the file, unless it is hidden meanwhile. */
  async load(file, url) {
    const head = file.type === "image/jpeg" ? await file.slice(0, HEAD).arrayBuffer() : null;
    if (this.url !== url) return 0;
    const thumbnail = head && thumbnailIn(head);
    if (thumbnail) {
      this.image.src = thumbnail;
      await painted();
    }
    const picture = new Image();
    await new Promise((resolve, reject) => Object.assign(picture, { onload: resolve, onerror: reject, src: url }));
    if (this.url !== url) return 0;
    this.image.src = url;
    await painted();
    return picture.naturalWidth * picture.naturalHeight;
  }

  hide() {
    URL.revokeObjectURL(this.url);
    this.url = "";
    this.image.removeAttribute("src");
    this.tell(0);
  }
}

/** Resolves once what is there has been handed to the screen. @returns {Promise<void>} */
function painted() {
  return new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve, 0)));
}

/** The thumbnail of a file that may be damaged. @param {ArrayBuffer} head */
function thumbnailIn(head) {
  try {
    return thumbnailOf(new DataView(head));
  } catch {
    return null;
  }
}

/**
 * The thumbnail of a JPEG file of a camera as an address, turned as the picture is; null where there is none.
 * Exif 2.32, sections 4.5 to 4.7.
 * @param {DataView} head  How the file begins.
 */
export function thumbnailOf(head) {
  const isExif = head.getUint32(0) === 0xffd8ffe1 && head.getUint32(6) === 0x45786966;
  if (!isExif) return null;
  const tiff = 12, end = 4 + head.getUint16(4), isLittle = head.getUint16(tiff) === 0x4949;
  const long = (/** @type {number} */ at) => head.getUint32(tiff + at, isLittle);
  const short = (/** @type {number} */ at) => head.getUint16(tiff + at, isLittle);
  // The second directory is that of the thumbnail.
  const first = long(4), second = long(first + 2 + 12 * short(first));
  if (!second) return null;
  /** @type {Record<number, number>} */
  const fields = {};
  for (let i = 0; i < short(second); i++) fields[short(second + 2 + 12 * i)] = long(second + 10 + 12 * i);
  const { 0x201: start, 0x202: length } = fields;
  if (!start || !length || tiff + start + length > end) return null;
  // Behind the Exif data of the picture, which say how it is turned.
  const bytes = new Uint8Array(head.buffer);
  let text = "";
  for (const part of [bytes.subarray(0, end), bytes.subarray(tiff + start + 2, tiff + start + length)]) {
    for (const byte of part) text += String.fromCharCode(byte);
  }
  return `data:image/jpeg;base64,${btoa(text)}`;
}
