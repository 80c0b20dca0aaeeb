// What studio/README.md says of times, bytes and work: node browse.mjs times http://SERVICE [sight|beside|network|heap]
// Nothing here is a test: times are those of the machine, and ratios of what runs side by side.

import { readFileSync } from "node:fs";
import { jpegOf, withThumbnail } from "../camera.mjs";
import { PICTURE, began, choose, chosen, finished, method, opened, running, sentBy, service } from "../browser.mjs";

const TRIES = 3;
/** Bits a second down and up, and milliseconds for an answer. */
const NETWORKS = { "3G": [1_500_000, 750_000, 300], "slow 3G of the browser's tools": [400_000, 400_000, 2000] };

const median = (values) => values.sort((a, b) => a - b)[values.length >> 1];

/** Milliseconds from the choice of a file to the first pixels of it on the screen. */
async function seenAfter(page, file) {
  await page.evaluate(() => {
    globalThis.seen = new Promise((resolve) => {
      let began = Infinity;
      document.getElementById("file").addEventListener("change", () => (began = performance.now()), { once: true, capture: true });
      document.getElementById("first-sight").setAttribute("elementtiming", "sight");
      new PerformanceObserver((list) => {
        const painted = list.getEntries().find(({ renderTime }) => renderTime > began);
        if (painted) resolve(painted.renderTime - began);
      }).observe({ type: "element" });
      // Where the picture is drawn before that, it is seen so.
      const { renderer } = studio.stage, setOriginal = renderer.setOriginal;
      renderer.setOriginal = function (bitmap) {
        setOriginal.call(this, bitmap);
        renderer.setOriginal = setOriginal;
        requestAnimationFrame(() => requestAnimationFrame(() => resolve(performance.now() - began)));
      };
    });
  });
  await page.setInputFiles("#file", file);
  const took = await page.evaluate(() => globalThis.seen);
  await page.waitForFunction(() => studio.source.bitmap);
  await page.evaluate(() => document.getElementById("cancel-button").click());
  return took;
}

async function sight(page) {
  const large = await jpegOf(page, 4000, 3000), thumbnail = await jpegOf(page, 160, 120);
  const jpeg = (name, buffer) => ({ name, mimeType: "image/jpeg", buffer });
  const files = {
    "384 by 256 pixels": PICTURE,
    "12 megapixels with a thumbnail": jpeg("camera.jpg", withThumbnail(large, thumbnail)),
    "12 megapixels without one": jpeg("bare.jpg", large),
  };
  for (const [name, file] of Object.entries(files)) {
    const took = [];
    for (let i = 0; i < TRIES; i++) took.push(await seenAfter(page, file));
    console.log(`${name}: seen after ${median(took).toFixed(0)} ms (${took.map((ms) => ms.toFixed(0)).join(", ")})`);
  }
}

/** The page beside a client that submits the same job, follows it and takes its mesh. */
async function beside(page) {
  const pages = [], clients = [];
  await chosen(page, PICTURE);
  const { id, query } = await page.evaluate(() => ({ id: studio.source.job, query: new URLSearchParams(studio.tracks[0].parameters).toString() }));
  for (let i = 0; i < TRIES; i++) {
    let start = performance.now();
    const body = readFileSync(PICTURE);
    const job = await (await fetch(`${service}/v1/jobs?${query}`, { method: "POST", body })).json();
    await (await fetch(`${service}/v1/jobs/${job.id}/events`)).text();
    await (await fetch(`${service}/v1/jobs/${job.id}/mesh?format=progression`)).arrayBuffer();
    clients.push(performance.now() - start);
    await page.evaluate(() => (globalThis.ready = new Promise((resolve) => {
      const { tracks: [track], stage: { renderer } } = studio, setMesh = renderer.setMesh;
      renderer.setMesh = function (...all) {
        setMesh.apply(this, all);
        if (track.stage !== "final") return;
        renderer.setMesh = setMesh;
        resolve();
      };
    })));
    start = performance.now();
    await page.setInputFiles("#file", PICTURE);
    await page.evaluate(() => globalThis.ready);
    pages.push(performance.now() - start);
    await finished(page);
  }
  const [page_, client] = [median(pages), median(clients)];
  console.log(`the final mesh of ${id}: ${page_.toFixed(0)} ms in the page, ${client.toFixed(0)} ms by the API alone: ${(100 * (page_ / client - 1)).toFixed(0)} % more`);
}

async function network(page) {
  const session = await page.context().newCDPSession(page);
  for (const [name, [down, up, latency]] of Object.entries(NETWORKS)) {
    await method(page, "mgprfs");
    await finished(page);
    const sent = sentBy(page);
    await session.send("Network.emulateNetworkConditions", { offline: false, latency, downloadThroughput: down / 8, uploadThroughput: up / 8 });
    const start = performance.now();
    let preview = 0;
    await running(page, async () => {
      await method(page, "med");
      await page.waitForFunction(() => studio.tracks[0].stage !== "none" && studio.tracks[0].parameters.method === "med");
      preview = performance.now() - start;
    });
    console.log(`${name}: another method is seen after ${preview.toFixed(0)} ms, its final mesh after ${(performance.now() - start).toFixed(0)} ms; ` +
      `${sent.filter(({ hasPicture }) => hasPicture).length} pictures sent`);
    await session.send("Network.emulateNetworkConditions", { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: -1 });
  }
}

async function heap(page) {
  const session = await page.context().newCDPSession(page);
  await page.waitForTimeout(500);
  await session.send("HeapProfiler.collectGarbage");
  const { usedSize } = await session.send("Runtime.getHeapUsage");
  console.log(`the heap at rest holds ${(usedSize / 1e6).toFixed(1)} MB`);
}

/** Measures all of it, or the parts that are named. */
export async function times(...names) {
  const parts = { sight, beside, network, heap };
  for (const name of names.length ? names : Object.keys(parts)) {
    const page = await opened();
    await began(page);
    const sent = sentBy(page);
    if (name !== "sight") await choose(page);
    if (name === "heap") console.log(`${sent.filter(({ hasPicture }) => hasPicture).length} upload of a picture`);
    await parts[name](page);
    await page.context().close();
  }
}
