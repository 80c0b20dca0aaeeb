// What is seen first of a picture, of one too large for the graphics, and of one that is easy to mesh.

import { strict as assert } from "node:assert";
import { jpegOf, withThumbnail } from "../camera.mjs";
import { began, bytesOf, chosen, finished, opened } from "../browser.mjs";

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

/** A preview that is closer than the mesh stays: of a drawing, whose perfect copy is said so. */
export async function closer() {
  const page = await opened();
  await began(page);
  const side = 64, head = Buffer.from(`P7\nWIDTH ${side}\nHEIGHT ${side}\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n`);
  const body = Buffer.alloc(4 * side * side);
  for (let y = 8; y < 56; y++) for (let x = 8; x < 56; x++) body.set(x > 30 ? [20, 120, 220, 255] : [220, 60, 20, 255], 4 * (y * side + x));
  // The preview comes first, however quick the job is.
  await page.route("**/events", async (route) => {
    await page.waitForFunction(() => studio.tracks[0].previewed > 0 || studio.tracks[0].parameters.method === "preview");
    await route.continue().catch(() => {});
  });
  await page.setInputFiles("#file", { name: "drawing.pam", mimeType: "image/x-portable-anymap", buffer: Buffer.concat([head, body]) });
  await page.waitForFunction(() => studio.source.name === "drawing.pam" && studio.machine.hasMesh && studio.tracks[0].parameters.method === "preview");
  await finished(page);
  console.log(`the preview is kept: ${await page.textContent("#figure-psnr")}`);
  assert.match(await page.textContent("#figure-likeness"), /dentical/);
  assert.deepEqual(page.failures, []);
}
