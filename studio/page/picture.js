// The original: as the browser decodes it, or as the service does.

import { query, request } from "./api.js";

/**
 * A picture of samples, pixel by pixel, rows from the bottom.
 * @typedef {object} Picture
 * @property {number} width
 * @property {number} height
 * @property {number} components
 * @property {number} precision
 * @property {Uint8Array | Uint16Array} samples
 */
/**
 * A picture of four bytes a pixel, rows from the bottom; smaller than the picture itself where the graphics could not
 * hold that.
 * @typedef {{ width: number, height: number, rgba: Uint8Array, fullWidth: number, fullHeight: number }} Bitmap
 */
/** @typedef {{ width: number, height: number, components: number, precision: number }} Shape */

/**
 * The samples of a bitmap that the browser has not changed: of eight bits and nowhere transparent;
 * null for others.
 * @param {Bitmap} bitmap @param {Shape} shape
 * @returns {Picture | null}
 */
export function samplesOf({ width, height, rgba }, shape) {
  const { components, precision } = shape;
  const isSame = width === shape.width && height === shape.height;
  if (!isSame || precision !== 8) return null;
  const from = components >= 3 ? [0, 1, 2, 3] : [0, 3];
  const samples = new Uint8Array(width * height * components);
  for (let i = 0; i < width * height; i++) {
    if (rgba[4 * i + 3] !== 255) return null;
    for (let c = 0; c < components; c++) samples[i * components + c] = rgba[4 * i + from[c]];
  }
  return { width, height, components, precision, samples };
}

/**
 * The picture as the service decodes it: the picture of the mesh that has every pixel as a vertex.
 * @param {string} job  A job of it. @param {import("./api.js").Parameters} reading  How it is to be read.
 * @param {AbortSignal} signal
 */
export async function fromService(job, reading, signal) {
  const path = `/v1/meshes?${query({ ...reading, image_of: job, method: "med", density: "100", format: "pnm" })}`;
  const response = await request(path, { method: "POST", signal });
  return readPnm(new Uint8Array(await response.arrayBuffer()));
}

/** @param {Uint8Array} bytes @returns {Picture} */
export function readPnm(bytes) {
  const isPam = bytes[1] === 0x37;
  const lines = isPam ? /^P7\n[^]*?ENDHDR\n/ : /^P[56]\s+\d+\s+\d+\s+\d+\s/;
  const head = lines.exec(new TextDecoder("latin1").decode(bytes.subarray(0, 512)))?.[0] ?? "";
  /** @param {string} name */
  const field = (name) => Number(new RegExp(`${name} (\\d+)`).exec(head)?.[1]);
  const [width, height, most] = isPam ? ["WIDTH", "HEIGHT", "MAXVAL"].map(field) : head.split(/\s+/).slice(1, 4).map(Number);
  const components = isPam ? field("DEPTH") : bytes[1] === 0x36 ? 3 : 1;
  const isWide = most > 255, row = width * components;
  const samples = isWide ? new Uint16Array(row * height) : new Uint8Array(row * height);
  for (let y = 0; y < height; y++) {
    const from = head.length + (height - 1 - y) * row * (isWide ? 2 : 1);
    for (let i = 0; i < row; i++) {
      samples[y * row + i] = isWide ? bytes[from + 2 * i] * 256 + bytes[from + 2 * i + 1] : bytes[from + i];
    }
  }
  return { width, height, components, precision: Math.ceil(Math.log2(most + 1)), samples };
}

/**
 * What is stretched to black and white where a picture of more than 8 bits uses less than half of its range.
 * @param {Picture} picture @returns {[number, number]}  The lowest and the highest level shown, 0 to 1.
 */
export function levelsOf({ precision, components, samples }) {
  if (precision <= 8 || components > 2) return [0, 1];
  let low = Infinity, high = 0;
  for (let i = 0; i < samples.length; i += components) [low, high] = [Math.min(low, samples[i]), Math.max(high, samples[i])];
  const most = 2 ** precision - 1;
  return high > low && high - low < most / 2 ? [low / most, high / most] : [0, 1];
}

/** @param {Picture} picture @param {[number, number]} levels @returns {Bitmap} */
export function bitmapOf({ width, height, components, precision, samples }, [low, high]) {
  const rgba = new Uint8Array(4 * width * height), most = 2 ** precision - 1;
  const hasAlpha = components === 2 || components === 4;
  for (let i = 0; i < width * height; i++) {
    for (let k = 0; k < 3; k++) {
      const c = components >= 3 ? k : 0;
      rgba[4 * i + k] = Math.round((255 * (samples[i * components + c] / most - low)) / (high - low));
    }
    rgba[4 * i + 3] = hasAlpha ? Math.round((samples[(i + 1) * components - 1] * 255) / most) : 255;
  }
  return { width, height, rgba, fullWidth: width, fullHeight: height };
}
