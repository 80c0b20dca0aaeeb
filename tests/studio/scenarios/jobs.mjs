// Pictures in, jobs followed, what goes wrong.

import { strict as assert } from "node:assert";
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { PICTURE, began, choose, finished, grayPicture, opened, service, settled, setSize } from "../browser.mjs";

export async function upload() {
  const page = await opened();
  await finished(page);
  const began = Date.now();
  await page.setInputFiles("#file", PICTURE);
  await page.waitForFunction(() => {
    const { tracks, source, stage } = studio;
    return source.name === "picture.png" && tracks[0].stage !== "none" && stage.renderer.meshes[0];
  });
  const first = await page.evaluate(async () => studio.tracks[0].stage);
  console.log(`a first mesh (${first}) after ${Date.now() - began} ms`);
  assert.equal(await finished(page), 1966);
  console.log(`the mesh after ${Date.now() - began} ms`);
  assert.equal(await page.textContent("#figure-vertices"), "1,966");
  assert.match(await page.textContent("#figure-psnr"), /^\d\d\.\d\d dB$/);
  assert.match(await page.textContent("#status"), /The mesh is there: 1,966 vertices/);
  // The preview was seen on the way.
  await drop(page);
  await paste(page);
  assert.deepEqual(page.failures, []);
}

async function drop(page) {
  const transfer = await transferOf(page, "dropped.png");
  await page.dispatchEvent("body", "dragover", { dataTransfer: transfer });
  assert.ok(await page.isVisible("#drop-hint"));
  await page.dispatchEvent("body", "drop", { dataTransfer: transfer });
  await page.waitForSelector("#picture-note:has-text('dropped.png')");
  assert.equal(await finished(page), 1966);
}

async function paste(page) {
  const transfer = await transferOf(page, "pasted.png");
  await page.evaluate((clipboardData) => {
    document.dispatchEvent(new ClipboardEvent("paste", { clipboardData, bubbles: true }));
  }, transfer);
  await page.waitForSelector("#picture-note:has-text('pasted.png')");
  assert.equal(await finished(page), 1966);
}

function transferOf(page, name) {
  return page.evaluateHandle(([bytes, name]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([Uint8Array.from(bytes)], name, { type: "image/png" }));
    return transfer;
  }, [[...readFileSync(PICTURE)], name]);
}

export async function cancel() {
  const page = await opened("/?sample=spheres&method=mgpr&effort=9");
  await page.waitForSelector("#progress:not([hidden])");
  // A preview is there meanwhile.
  await page.waitForFunction(() => studio.tracks[0].stage === "preview");
  const stages = new Set();
  const until = Date.now() + 60_000;
  while (stages.size < 2 && Date.now() < until) {
    stages.add(await page.textContent("#progress-stages [aria-current]"));
    await page.waitForTimeout(50);
  }
  await page.waitForFunction(() => /^\d+ %, about \d+ s left$/.test(document.getElementById("progress-percent").textContent));
  console.log(`stages seen: ${[...stages].join(", ")}`);
  const id = await page.evaluate(async () => studio.tracks[0].job.id);
  const began = Date.now();
  await page.click("#cancel-button");
  await page.waitForSelector("#progress", { state: "hidden" });
  for (;;) {
    const { state } = await (await fetch(`${service}/v1/jobs/${id}`)).json();
    if (state === "cancelled") break;
    assert.equal(state, "running");
    assert.ok(Date.now() - began < 5000, "the service has not cancelled it");
  }
  console.log(`cancelled at the service after ${Date.now() - began} ms`);
  assert.equal(await page.textContent("#status"), "Cancelled.");
  // Another run works.
  await page.selectOption("#method-select", "med");
  await finished(page);
  assert.deepEqual(page.failures, []);
}

export async function slider() {
  const page = await opened();
  const most = await choose(page);
  const slider = page.locator("#size-slider");
  await slider.focus();
  await page.keyboard.press("Home");
  await settled(page);
  assert.equal(await page.textContent("#figure-vertices"), "4");
  await page.keyboard.press("End");
  await settled(page);
  assert.equal(await page.textContent("#figure-vertices"), most.toLocaleString("en"));
  assert.match(await slider.getAttribute("aria-valuetext"), /1,966 vertices, \d\d\.\d\d dB/);
  const path = await page.evaluate(async () => `/v1/jobs/${studio.tracks[0].job.id}/mesh`);
  for (const size of [4, 5, 60, 777, 1965]) {
    await setSize(page, size);
    const answer = await fetch(`${service}${path}?size=${size}&format=pmesh`);
    const shown = await page.evaluate(async () => studio.tracks[0].psnr);
    assert.ok(Math.abs(shown - Number(answer.headers.get("mesh-psnr"))) < 1e-9, `${size}: ${shown}`);
    assert.equal(await page.evaluate(async () => studio.tracks[0].faceCount), Number(answer.headers.get("mesh-faces")));
    const bytes = Number(answer.headers.get("content-length"));
    const text = bytes < 1000 ? `${bytes} B` : `${(bytes / 1000).toFixed(1)} kB`;
    await page.waitForFunction((text) => document.getElementById("figure-bytes").textContent === text, text);
  }
  // From the hand to the screen.
  const took = await page.evaluate(async (most) => {
    const times = [];
    for (let i = 1; i <= 40; i++) {
      const size = Math.round(4 + ((most - 5) * i) / 41);
      const began = performance.now();
      studio.setSize(size);
      while (studio.stage.renderer.meshes[0].geometry.vertexCount !== size) await new Promise((resolve) => setTimeout(resolve, 0));
      studio.stage.draw();
      times.push(performance.now() - began);
    }
    return times.sort((a, b) => a - b);
  }, most);
  // A busy machine lets the worker wait for its turn: what the page itself takes is the least.
  console.log(`a size is drawn after ${took[0].toFixed(1)} ms at least, ${took[20].toFixed(1)} ms (median of 40), ${took[39].toFixed(1)} ms at most`);
  assert.ok(took[3] < 100, took.join(" "));
  // The curve is dragged like the slider, and rises.
  const box = await page.locator("#curve").boundingBox();
  await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
  await settled(page);
  const size = await page.evaluate(async () => studio.tracks[0].size);
  assert.ok(size > 40 && size < 400, String(size));
  const psnrs = await page.evaluate(async () => [...studio.tracks[0].curve.values()]);
  assert.ok(psnrs.length > 50 && psnrs.at(-1) > psnrs[0] + 10);
  assert.deepEqual(page.failures, []);
}

export async function errors() {
  const page = await opened();
  await finished(page);
  await page.setInputFiles("#file", { name: "poem.png", mimeType: "image/png", buffer: Buffer.from("no picture at all") });
  const said = page.locator("#failure");
  await said.waitFor();
  assert.equal(await said.getAttribute("role"), "alert");
  assert.match(await said.textContent(), /Unsupported image format.*\. Use PNG, JPEG/);
  await page.click("#failure-close");
  assert.ok(await said.isHidden());
  // A method that is not for such a picture.
  await page.setInputFiles("#file", PICTURE);
  await finished(page);
  await page.selectOption("#method-select", "gpr");
  await said.waitFor();
  assert.match(await said.textContent(), /components.*Choose a method for this kind of picture/);
  await page.selectOption("#method-select", "mgprfs");
  await finished(page);
  assert.ok(await said.isHidden());
  // A value out of bounds does not leave the page.
  await page.fill("#amount", "101");
  await page.press("#amount", "Enter");
  assert.ok(await page.locator("#amount").evaluate((input) => !input.validity.valid));
  // A format that browsers do not show is shown all the same.
  await page.fill("#amount", "3");
  await choose(page, grayPicture(90, 70));
  await page.waitForFunction(() => studio.source.picture?.precision === 16);
  // A mesh whose sizes do not follow from an order has one.
  await page.selectOption("#method-select", "flat");
  await page.waitForFunction(() => studio.tracks[0].parameters.method === "flat");
  await finished(page);
  assert.ok(await page.locator("#size-slider").isDisabled());
  assert.match(await page.textContent("#size-note"), /one size/);
  assert.deepEqual(page.failures, []);
}

export async function away() {
  const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();
  const page = await opened("/?sample=spheres&method=mgprfs&density=8");
  await page.waitForSelector("#progress:not([hidden])");
  await began(page);
  console.log("take it away");
  assert.equal((await lines.next()).value, "gone");
  await page.waitForSelector("#progress-stage:has-text('The service is away')");
  // What was there stays usable.
  await page.click("#wireframe-button");
  console.log("bring it back");
  assert.equal((await lines.next()).value, "back");
  // The work begins again, on a machine that may be busy.
  await finished(page, 240_000);
  const job = await page.evaluate(async () => globalThis.studio?.tracks[0].job);
  assert.equal(job.state, "completed");
  assert.ok(job.attempt >= 1);
  assert.ok(await page.isHidden("#failure"));
  await page.context().close();
}
