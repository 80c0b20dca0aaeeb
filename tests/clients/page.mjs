// The example for browsers, used as people use it:
// node page.mjs http://PAGES http://SERVICE http://CLOSED-SERVICE. Prints what the page shows.

import { strict as assert } from "node:assert";
import { readFile } from "node:fs/promises";
import { browser, PICTURE } from "../studio/browser.mjs";

const [pages, service, closed] = process.argv.slice(2);
try {
  const page = await browser.newPage();
  await page.goto(`${pages}/browser.html`);

  await page.fill("#url", service);
  const saving = page.waitForEvent("download");
  await page.setInputFiles("#picture", PICTURE);
  const saved = await saving;
  assert.equal(saved.suggestedFilename(), "mesh.glb");
  assert.equal((await readFile(await saved.path())).toString("latin1", 0, 4), "glTF");
  await page.waitForFunction(() => document.getElementById("rebuilt").naturalWidth === 384);
  console.log(await page.textContent("#figures"));

  const mesh = await page.getAttribute("#mesh", "href");
  await page.fill("#url", closed);
  const another = { name: "another.png", mimeType: "image/png", buffer: await readFile(PICTURE) };
  await page.setInputFiles("#picture", another);
  await page.getByText("Refused. ").waitFor();
  assert.equal(await page.getAttribute("#mesh", "href"), mesh, "the former mesh stays");
} catch (error) {
  console.error(error);
  process.exitCode = 1;
} finally {
  await browser.close();
}
