// Paints our own pictures, and the thumbnails of a picture's outcomes, beside the page.

import { writtenPng } from "./png.js";
import { SAMPLES, painted } from "./samples.js";
import { thumbnailsOf } from "./thumbnails.js";

addEventListener("message", async ({ data }) => {
  const { id, name, width, height, thumbnailsOf: bitmap } = data;
  if (bitmap) {
    const images = thumbnailsOf(bitmap);
    postMessage({ id, images }, { transfer: Object.values(images) });
  } else {
    postMessage({ id, blob: await writtenPng(width, height, painted(SAMPLES[name], width, height)) });
  }
});
