// Pictures in, jobs followed, what goes wrong.

import { strict as assert } from "node:assert";
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { PICTURE, began, choose, finished, method, opened, service, settled, setSize } from "../browser.mjs";

export async function upload() {
  const page = await opened();
  await began(page);
  const start = Date.now();
  await page.setInputFiles("#file", PICTURE);
  await page.waitForFunction(() => studio.source.name === "picture.png" && (studio.source.bitmap || document.getElementById("first-sight").src));
  console.log(`the picture is seen after ${Date.now() - start} ms`);
  assert.equal(await finished(page), 2949);
  console.log(`the mesh after ${Date.now() - start} ms`);
  assert.equal(await page.textContent("#figure-vertices"), "2,949");
  assert.match(await page.textContent("#figure-psnr"), /^\d\d\.\d\d dB$/);
  assert.match(await page.textContent("#status"), /The mesh is ready: 2,949 vertices/);
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
  assert.equal(await finished(page), 2949);
}

async function paste(page) {
  const transfer = await transferOf(page, "pasted.png");
  await page.evaluate((clipboardData) => {
    document.dispatchEvent(new ClipboardEvent("paste", { clipboardData, bubbles: true }));
  }, transfer);
  await page.waitForSelector("#picture-note:has-text('pasted.png')");
  assert.equal(await finished(page), 2949);
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
  await page.waitForFunction(() => studio.machine.phase === "previewing");
  const stages = new Set();
  const until = Date.now() + 60_000;
  while (stages.size < 2 && Date.now() < until) {
    stages.add(await page.textContent("#progress-stage"));
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
  assert.match(await page.textContent("#size-note"), /Stopped: this is a rough preview/);
  assert.equal(await page.textContent("#run"), "Start again");
  assert.ok(await page.isDisabled("#download-button"));
  // Another run works.
  await method(page, "med");
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
  assert.match(await slider.getAttribute("aria-valuetext"), /2,949 vertices, \d\d\.\d\d dB/);
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
  // From the hand to the drawing. Two frames between sizes: software that draws falls behind, and would be timed too.
  const took = await page.evaluate(async (most) => {
    const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
    const times = [];
    for (let i = 1; i <= 40; i++) {
      const size = Math.round(4 + ((most - 5) * i) / 41);
      await frame();
      await frame();
      const began = performance.now();
      studio.setSize(size);
      while (studio.stage.renderer.meshes[0].geometry.vertexCount !== size) await new Promise((resolve) => setTimeout(resolve, 0));
      studio.stage.draw();
      times.push(performance.now() - began);
    }
    return times.sort((a, b) => a - b);
  }, most);
  console.log(`a size is drawn after ${took[20].toFixed(1)} ms (median of 40), ${took[39].toFixed(1)} ms at most`);
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

export async function away() {
  const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();
  const page = await opened("/?sample=spheres&method=mgprfs&density=8");
  await page.waitForFunction(() => globalThis.studio?.tracks[0].job);
  console.log("take it away");
  assert.equal((await lines.next()).value, "gone");
  await page.waitForSelector("#progress-stage:has-text('Connection lost')");
  // What was there stays usable.
  await page.click("#zoom-in");
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
