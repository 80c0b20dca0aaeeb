// What the scenarios share: a browser, the page in it, and pictures.

import { strict as assert } from "node:assert";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

export const service = process.argv[3];

/** A picture in colour of 384 by 256 pixels. */
export const PICTURE = fileURLToPath(new URL("../../docs/images/picture.png", import.meta.url));

/** A browser whose graphics are software, so that it draws anywhere. */
export const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});

/** A page that has failed in nothing yet; nothing in it moves by itself. */
export async function opened(path = "/", options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, reducedMotion: "reduce", acceptDownloads: true, ...options });
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  // What the page's module gives away, for what cannot be seen from outside.
  await context.addInitScript(() => {
    if (location.pathname !== "/") return;
    addEventListener("DOMContentLoaded", async () => (globalThis.studio = (await import("/studio/app.js")).studio));
  });
  const page = await context.newPage();
  page.setDefaultTimeout(120_000);
  page.failures = [];
  page.on("pageerror", (error) => page.failures.push(error.message));
  page.on("console", (message) => {
    const isRefusal = message.text().startsWith("Failed to load resource");
    if (message.type() === "error" && !isRefusal) page.failures.push(message.text());
  });
  await page.goto(service + path);
  return page;
}

/** Waits until the mesh of what was asked for is there, and returns its number of vertices. */
export async function finished(page, timeout = 120_000) {
  await page.waitForFunction(() => {
    const [track] = globalThis.studio?.tracks ?? [];
    return globalThis.studio?.machine.hasMesh && track.job && track.size > 0;
  }, null, { timeout });
  await settled(page);
  return page.evaluate(async () => studio.tracks[0].most);
}

/** Waits until what is asked for is drawn, and what follows from it is shown. */
export async function settled(page) {
  await page.waitForTimeout(250);
  await page.waitForFunction(() => {
    return studio.seen.every(({ side, size }) => !size || studio.stage.renderer.meshes[side]?.geometry.vertexCount === size);
  });
}

/** Chooses a file and waits for its mesh. */
export async function choose(page, file = PICTURE) {
  await began(page);
  await page.setInputFiles("#file", file);
  await page.waitForFunction((name) => globalThis.studio?.source?.name === name, nameOf(file));
  return finished(page);
}

/** Waits until the page has begun, so that a picture that is chosen comes after its first one. */
export async function began(page) {
  await page.waitForFunction(() => globalThis.studio?.form && studio.source);
}

/** Does what makes the page run, and waits for the mesh. */
export async function running(page, act) {
  const before = await page.evaluate(() => studio.machine.generation);
  await act();
  await page.waitForFunction((before) => studio.machine.generation > before, before);
  return finished(page);
}

/** Waits for the mesh of a file that the picker gives. */
export function chosen(page, file) {
  return running(page, () => page.setInputFiles("#file", file));
}

/** What is posted from now on, and whether the picture goes with it. */
export function sentBy(page) {
  const sent = [];
  page.on("request", (request) => {
    if (request.method() === "POST") sent.push({ url: request.url(), hasPicture: !request.url().includes("image_of=") });
  });
  return sent;
}

export function nameOf(file) {
  return typeof file === "string" ? file.split("/").pop() : file.name;
}

/** Chooses a method under Advanced. */
export async function method(page, name) {
  await page.evaluate(() => (document.getElementById("advanced").open = true));
  await page.selectOption("#method-select", name);
}

/** Sets the slider to a size by typing it. */
export async function setSize(page, size) {
  await page.fill("#size-number", String(size));
  await page.press("#size-number", "Enter");
  await settled(page);
}

/** The path of the mesh that is seen. */
export async function meshPath(page) {
  return page.evaluate(async () => `/v1/jobs/${studio.tracks[0].job.id}/mesh`);
}

/** The bytes that a function makes in the page: as text on the way, which takes a fraction of the time. */
export async function bytesOf(page, make, argument) {
  const text = await page.evaluate(`(async () => {
    const bytes = await (${make})(${JSON.stringify(argument)});
    const url = await new Promise((resolve) => {
      const reader = new FileReader();
      reader.onload = () => resolve(reader.result);
      reader.readAsDataURL(new Blob([bytes]));
    });
    return url.slice(url.indexOf(",") + 1);
  })()`);
  return Buffer.from(text, "base64");
}

/** The pixels of a picture of the service: bytes of red, green, blue and alpha, rows from the bottom. */
export function picturePixels(page, path) {
  return bytesOf(page, async (path) => {
    const { decoded } = await import("/studio/decode.js");
    return (await decoded(await (await fetch(path)).blob())).rgba;
  }, path);
}

/** A picture of 16 bits of gray, as PGM. */
export function grayPicture(width, height) {
  const head = Buffer.from(`P5\n${width} ${height}\n65535\n`);
  const body = Buffer.alloc(2 * width * height);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const disc = Math.hypot(x - width / 2, y - height / 3) < height / 4 ? 40000 : 0;
      body.writeUInt16BE(Math.min(65535, disc + Math.round((20000 * x) / width) + ((x * 7919 + y * 104729) % 800)), 2 * (y * width + x));
    }
  }
  return { name: "gray.pgm", mimeType: "image/x-portable-graymap", buffer: Buffer.concat([head, body]) };
}

/** A disc of two colours with a soft edge, and white where nothing is seen, as PAM. */
export function sprite(side) {
  const head = Buffer.from(`P7\nWIDTH ${side}\nHEIGHT ${side}\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n`);
  const body = Buffer.alloc(4 * side * side, 255);
  for (let y = 0; y < side; y++) {
    for (let x = 0; x < side; x++) {
      const alpha = Math.round(255 * Math.min(1, Math.max(0, (side / 3 - Math.hypot(x - side / 2, y - side / 2)) / 4)));
      const color = alpha === 0 ? [255, 255, 255] : x > y ? [200, 40, 20] : [20, 60, 180];
      body.set([...color, alpha], 4 * (y * side + x));
    }
  }
  return { name: "sprite.pam", mimeType: "image/x-portable-anymap", buffer: Buffer.concat([head, body]) };
}

/** The largest difference of what is seen of two pictures: of their colours times alpha, and of alpha. */
export function largestSeenDifference(a, b) {
  assert.equal(a.length, b.length);
  const seen = (rgba, i) => (i % 4 === 3 ? rgba[i] : Math.round((rgba[i] * rgba[i - (i % 4) + 3]) / 255));
  let most = 0;
  for (let i = 0; i < a.length; i++) most = Math.max(most, Math.abs(seen(a, i) - seen(b, i)));
  return most;
}

/** The largest difference of two pictures in red, green and blue. */
export function largestDifference(a, b) {
  assert.equal(a.length, b.length);
  let most = 0;
  for (let i = 0; i < a.length; i++) if (i % 4 !== 3) most = Math.max(most, Math.abs(a[i] - b[i]));
  return most;
}
