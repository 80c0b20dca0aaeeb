// What each preset makes of a picture, drawn small: a few hundred triangles of a few thousand
// pixels. It shows the kind of result; the real mesh is the service's.

import { densityOf } from "./density.js";
import { triangulate } from "./triangulate.js";

const WIDTH = 112, HEIGHT = 84;

/** @typedef {{ width: number, height: number, rgba: Uint8ClampedArray }} Small  Rows from the top. */

/** @param {import("./picture.js").Bitmap} bitmap @returns {Record<string, ImageBitmap>} */
export function thumbnailsOf(bitmap) {
  const small = reduced(bitmap);
  const photo = faceted(small, 900), coarse = faceted(small, 170), few = faceted(small, 40);
  /** @type {Record<string, Small>} */
  const made = {
    photo: drawn(small, photo), lowpoly: drawn(small, coarse), glass: drawn(small, faceted(small, 110), "#14110f"),
    sprite: small, logo: drawn(small, faceted(small, 320)), terrain: slopes(small), print: backlit(small),
    placeholder: blurred(drawn(small, few)), draft: drawn(small, faceted(small, 420), "#ffffff55"),
  };
  return Object.fromEntries(Object.entries(made).map(([name, { width, height, rgba }]) => {
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext("2d")?.putImageData(new ImageData(new Uint8ClampedArray(rgba), width, height), 0, 0);
    return [name, canvas.transferToImageBitmap()];
  }));
}

/** The middle of the picture. @param {import("./picture.js").Bitmap} bitmap @returns {Small} */
function reduced({ width, height, rgba }) {
  const scale = Math.min(width / WIDTH, height / HEIGHT);
  const left = (width - WIDTH * scale) / 2, low = (height - HEIGHT * scale) / 2;
  const small = new Uint8ClampedArray(4 * WIDTH * HEIGHT);
  const reach = Math.max(1, Math.min(4, Math.floor(scale)));
  for (let y = 0; y < HEIGHT; y++) {
    for (let x = 0; x < WIDTH; x++) {
      const sum = [0, 0, 0, 0];
      for (let dy = 0; dy < reach; dy++) {
        for (let dx = 0; dx < reach; dx++) {
          const column = Math.min(width - 1, Math.floor(left + (x + (dx + 0.5) / reach) * scale));
          const row = Math.min(height - 1, Math.floor(low + (HEIGHT - 1 - y + (dy + 0.5) / reach) * scale));
          for (let k = 0; k < 4; k++) sum[k] += rgba[4 * (row * width + column) + k];
        }
      }
      for (let k = 0; k < 4; k++) small[4 * (y * WIDTH + x) + k] = sum[k] / reach ** 2;
    }
  }
  return { width: WIDTH, height: HEIGHT, rgba: small };
}

/** Points by error diffusion of the density, triangulated. @param {Small} small @param {number} count */
function faceted({ width, height, rgba }, count) {
  const samples = new Uint8Array(3 * width * height);
  for (let i = 0; i < width * height; i++) samples.set(rgba.subarray(4 * i, 4 * i + 3), 3 * i);
  const density = densityOf({ width, height, components: 3, precision: 8, samples });
  let sum = 0;
  for (let i = 0; i < density.length; i++) sum += density[i] = density[i] ** 0.7 + 0.004;
  const xs = [], ys = [];
  const errors = new Float32Array(2 * (width + 2));
  for (let y = 0; y < height; y++) {
    const own = (y % 2) * (width + 2), next = width + 2 - own;
    errors.fill(0, next, next + width + 2);
    for (let x = 0; x < width; x++) {
      const wanted = (density[y * width + x] * count) / sum + errors[own + x + 1];
      const isCorner = (x === 0 || x === width - 1) && (y === 0 || y === height - 1);
      const isChosen = isCorner || wanted >= 0.5;
      if (isChosen) {
        xs.push(x);
        ys.push(y);
      }
      const rest = Math.max(-1, wanted - (isChosen ? 1 : 0));
      errors[own + x + 2] += (rest * 7) / 16;
      errors[next + x] += (rest * 3) / 16;
      errors[next + x + 1] += (rest * 5) / 16;
      errors[next + x + 2] += rest / 16;
    }
  }
  return { xs, ys, origins: triangulate(Int32Array.from(xs), Int32Array.from(ys)).origins };
}

/** Flat triangles, perhaps with edges. @param {Small} small @param {ReturnType<typeof faceted>} mesh @param {string} [edges] @returns {Small} */
function drawn({ width, height, rgba }, { xs, ys, origins }, edges) {
  const context = /** @type {OffscreenCanvasRenderingContext2D} */ (new OffscreenCanvas(width, height).getContext("2d"));
  context.lineJoin = "round";
  for (let f = 0; f < origins.length; f += 3) {
    const corners = [origins[f], origins[f + 1], origins[f + 2]];
    const x = Math.round(corners.reduce((sum, v) => sum + xs[v], 0) / 3), y = Math.round(corners.reduce((sum, v) => sum + ys[v], 0) / 3);
    const at = 4 * (y * width + x);
    const color = `rgb(${rgba[at]} ${rgba[at + 1]} ${rgba[at + 2]} / ${rgba[at + 3] / 255})`;
    context.beginPath();
    for (const v of corners) context.lineTo(xs[v] + 0.5, ys[v] + 0.5);
    context.closePath();
    context.fillStyle = color;
    context.fill();
    context.strokeStyle = edges ?? color;
    context.lineWidth = edges ? 1 : 0.7;
    context.stroke();
  }
  return { width, height, rgba: context.getImageData(0, 0, width, height).data };
}

/** @param {Small} small */
function lumas({ rgba }) {
  return Float32Array.from({ length: rgba.length / 4 }, (_, i) => 0.299 * rgba[4 * i] + 0.587 * rgba[4 * i + 1] + 0.114 * rgba[4 * i + 2]);
}

/** Light from the upper left on bright as high. @param {Small} small @returns {Small} */
function slopes(small) {
  const { width, height } = small, luma = lumas(small);
  const rgba = new Uint8ClampedArray(4 * width * height);
  for (let i = 0; i < width * height; i++) {
    const x = i % width, right = luma[i + (x + 1 < width ? 1 : 0)], below = luma[i + (i + width < luma.length ? width : 0)];
    const light = 150 + 3 * (right - luma[i]) + 3 * (below - luma[i]), high = luma[i] / 255;
    rgba.set([light * (0.62 + 0.38 * high), light * (0.78 + 0.16 * high), light * (0.55 + 0.4 * high), 255], 4 * i);
  }
  return { width, height, rgba };
}

/** A plate before a lamp. @param {Small} small @returns {Small} */
function backlit(small) {
  const { width, height } = small, luma = lumas(small);
  const rgba = new Uint8ClampedArray(4 * width * height);
  for (let i = 0; i < width * height; i++) {
    const x = i % width, y = Math.floor(i / width);
    const isFrame = x < 4 || y < 4 || x >= width - 4 || y >= height - 4;
    const light = isFrame ? 40 : 50 + 0.8 * luma[i];
    rgba.set([light * 1.05, light * 0.9, light * 0.68, 255], 4 * i);
  }
  return { width, height, rgba };
}

/** @param {Small} small @returns {Small} */
function blurred({ width, height, rgba }) {
  const from = new OffscreenCanvas(width, height), to = /** @type {OffscreenCanvasRenderingContext2D} */ (new OffscreenCanvas(width, height).getContext("2d"));
  from.getContext("2d")?.putImageData(new ImageData(new Uint8ClampedArray(rgba), width, height), 0, 0);
  to.filter = "blur(5px)";
  to.drawImage(from, -4, -3, width + 8, height + 6);
  return { width, height, rgba: to.getImageData(0, 0, width, height).data };
}
