// Paints our own pictures beside the page.

import { writtenPng } from "./png.js";
import { SAMPLES, painted } from "./samples.js";

addEventListener("message", async ({ data }) => {
  const { name, width, height } = data;
  postMessage({ name, width, blob: await writtenPng(width, height, painted(SAMPLES[name], width, height)) });
});
