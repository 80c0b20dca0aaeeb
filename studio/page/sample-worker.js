// Paints our own pictures beside the page.

import { SAMPLES, painted } from "./samples.js";

addEventListener("message", async ({ data }) => {
  const { name, width, height } = data;
  const canvas = new OffscreenCanvas(width, height);
  const context = /** @type {OffscreenCanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.putImageData(new ImageData(painted(SAMPLES[name], width, height), width, height), 0, 0);
  postMessage({ name, width, blob: await canvas.convertToBlob({ type: "image/png" }) });
});
