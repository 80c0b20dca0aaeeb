// What is seen first of a picture, of one too large for the graphics, and what drawings become.

import { strict as assert } from "node:assert";
import { jpegOf, withThumbnail } from "../camera.mjs";
import { began, bytesOf, chosen, opened } from "../browser.mjs";

/** The thumbnail of a camera's file is seen before the picture, turned as the picture is. */
export async function camera() {
  const page = await opened();
  await began(page);
  const [picture, red] = [await jpegOf(page, 96, 64), await jpegOf(page, 16, 12, "#f00")];
  await page.evaluate(() => {
    const image = document.getElementById("first-sight");
    globalThis.shown = [];
    image.addEventListener("load", () => globalThis.shown.push({ url: image.src.slice(0, 5), width: image.naturalWidth, height: image.naturalHeight }));
  });
  const shownOf = async (buffer) => {
    await page.evaluate(() => (globalThis.shown.length = 0));
    await chosen(page, { name: "camera.jpg", mimeType: "image/jpeg", buffer });
    return page.evaluate(() => globalThis.shown);
  };
  const thumbnailThen = (width, height) => ({ url: "data:", width, height });
  assert.deepEqual((await shownOf(withThumbnail(picture, red)))[0], thumbnailThen(16, 12));
  assert.deepEqual((await shownOf(withThumbnail(picture, red, 6)))[0], thumbnailThen(12, 16));
  assert.equal(await page.evaluate(() => studio.source.bitmap.fullHeight), 96);
  // What a file says wrongly of its thumbnail keeps nobody from its picture.
  const wrong = withThumbnail(picture, red);
  wrong.writeUInt32LE(0x7fffffff, 16);
  assert.notEqual((await shownOf(wrong))[0]?.url, "data:");
  assert.deepEqual(page.failures, []);
}

/** A picture of more pixels a side than the graphics have is shown smaller. */
export async function large() {
  const page = await opened();
  await began(page);
  const most = await page.evaluate(() => studio.stage.renderer.maxSide);
  const buffer = await bytesOf(page, async (width) => {
    const canvas = new OffscreenCanvas(width, 24), context = canvas.getContext("2d");
    for (let x = 0; x < width; x += 40) {
      context.fillStyle = `hsl(${x % 360} 60% 50%)`;
      context.fillRect(x, 0, 40, 24);
    }
    return new Uint8Array(await (await canvas.convertToBlob()).arrayBuffer());
  }, most + 500);
  await chosen(page, { name: "wide.png", mimeType: "image/png", buffer });
  const { width, fullWidth, target } = await page.evaluate(() => ({ ...studio.source.bitmap, rgba: null, target: studio.stage.renderer.targetSize[0] }));
  assert.deepEqual([fullWidth, width, target], [most + 500, most, most]);
  assert.match(await page.textContent("#picture-note"), new RegExp((most + 500).toLocaleString("en")));
  assert.deepEqual(page.failures, []);
}

/** A drawing of few colours gets what keeps its edges, and a copy without any error is called identical. */
export async function drawing() {
  const page = await opened();
  await began(page);
  const buffer = await bytesOf(page, async () => {
    const canvas = new OffscreenCanvas(160, 120), context = canvas.getContext("2d");
    context.fillStyle = "#fff";
    context.fillRect(0, 0, 160, 120);
    context.fillStyle = "#123";
    for (let i = 0; i < 12; i++) context.fillRect(10 + 36 * (i % 4), 10 + 36 * Math.floor(i / 4), 20, 20);
    return new Uint8Array(await (await canvas.convertToBlob()).arrayBuffer());
  });
  await chosen(page, { name: "drawing.png", mimeType: "image/png", buffer });
  assert.equal(await page.getAttribute("[data-preset=logo]", "aria-pressed"), "true");
  assert.equal(await page.textContent("#figure-likeness"), "Identical");
  assert.deepEqual(page.failures, []);
}
