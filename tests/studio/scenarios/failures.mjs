// What goes wrong, and what must not: stale views, races, needless work.

import { strict as assert } from "node:assert";
import { PICTURE, began, choose, chosen, finished, grayPicture, method, opened, running, sentBy, service, settled, setSize } from "../browser.mjs";

/** A picture of noise, which takes its time. */
function noise(side, name) {
  const head = Buffer.from(`P6\n${side} ${side}\n255\n`);
  const body = Buffer.alloc(3 * side * side);
  let state = 1;
  for (let i = 0; i < body.length; i++) body[i] = (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) >>> 24;
  return { name, mimeType: "image/x-portable-pixmap", buffer: Buffer.concat([head, body]) };
}

export async function errors() {
  const page = await opened();
  await choose(page);
  await page.setInputFiles("#file", { name: "poem.png", mimeType: "image/png", buffer: Buffer.from("no picture at all") });
  const said = page.locator("#failure");
  await said.waitFor();
  assert.equal(await said.getAttribute("role"), "alert");
  assert.match(await page.textContent("#failure-text"), /^That is not a picture this server reads\. Use PNG, JPEG.*PNM\.$/);
  // Nothing of the picture before is left.
  assert.equal(await page.textContent("#figure-vertices"), "–");
  assert.equal(await page.evaluate(() => studio.machine.phase), "failed");
  assert.ok(await page.evaluate(() => studio.stage.renderer.meshes.every((mesh) => mesh === null) && !studio.source.bitmap));
  assert.ok(await page.isDisabled("#download-button"));
  assert.ok(await page.isVisible("#empty"));
  await page.click("#failure-close");
  assert.ok(await said.isHidden());
  // Methods for another kind of picture are not offered.
  await chosen(page, PICTURE);
  assert.ok(await page.locator("#method-select option[value=gpr]").evaluate((option) => option.disabled));
  assert.ok(await page.locator("#method-select option[value=mgpr]").evaluate((option) => !option.disabled));
  // A value out of bounds does not leave the page.
  await page.fill("#amount", "101");
  await page.press("#amount", "Enter");
  assert.ok(await page.locator("#amount").evaluate((input) => !input.validity.valid));
  await page.fill("#amount", "3");
  await page.press("#amount", "Enter");
  await finished(page);
  // A format that browsers do not show is shown all the same.
  await choose(page, grayPicture(90, 70));
  await page.waitForFunction(() => studio.source.picture?.precision === 16 && studio.source.bitmap);
  assert.ok(await page.locator("#method-select option[value=gpr]").evaluate((option) => !option.disabled));
  assert.deepEqual(page.failures, []);
}

export async function visit() {
  const page = await opened();
  const sent = sentBy(page);
  await page.waitForFunction(() => globalThis.studio?.stage.renderer.meshes[0]);
  await settled(page);
  // The first view: a sample of some 600 vertices with an open split, and no job for it.
  assert.equal(await page.textContent("#figure-vertices"), "600");
  assert.ok(await page.isVisible("#divider-line"));
  assert.match(await page.textContent("#figure-likeness"), /close/i);
  assert.deepEqual(sent, []);
  assert.equal((await (await fetch(`${service}/v1/jobs`)).json()).jobs.length, 0);
  assert.equal(await page.locator("#history li").count(), 0);
  assert.equal(new URL(page.url()).search, "");
  // The mesh of the page is one of its picture: what it says of itself holds.
  const far = await page.evaluate(() => {
    const { renderer } = studio.stage, drawn = renderer.readPicture(0), { rgba } = studio.source.bitmap;
    let sum = 0, count = 0;
    for (let i = 0; i < drawn.length; i++) if (i % 4 !== 3) [sum, count] = [sum + (drawn[i] - rgba[i]) ** 2, count + 1];
    return Math.abs(10 * Math.log10(255 ** 2 / (sum / count)) - studio.tracks[0].psnr);
  });
  assert.ok(far < 0.3, `${far} dB off`);
  // Taking it makes it one of the service's.
  await page.click("#download-button");
  await page.waitForSelector("#export-dialog[open]");
  assert.equal(sent.filter(({ url }) => url.includes("/v1/jobs")).length, 1);
  assert.deepEqual(page.failures, []);
}

export async function once() {
  const page = await opened();
  await began(page);
  const sent = sentBy(page);
  await chosen(page, PICTURE);
  for (const name of ["med", "flat", "mgprfs"]) {
    await method(page, name);
    await page.waitForFunction((name) => studio.tracks[0].parameters.method === name, name);
    await finished(page);
  }
  await page.evaluate(() => (document.getElementById("advanced").open = true));
  await page.selectOption("#compared-select", "med");
  await page.waitForFunction(() => studio.machine.hasMesh && studio.tracks.every(({ stage, job }) => stage === "final" && job));
  const uploads = sent.filter(({ hasPicture }) => hasPicture);
  console.log(`${sent.length} requests for six meshes, ${uploads.length} of them with the picture`);
  assert.equal(uploads.length, 1, JSON.stringify(sent));
  // Enter in the field, and leaving it for the button, run once.
  await page.selectOption("#compared-select", "");
  await finished(page);
  for (const run of ["Enter", "click"]) {
    sent.length = 0;
    await running(page, async () => {
      await page.fill("#amount", run === "Enter" ? "1" : "1.5");
      if (run === "Enter") await page.press("#amount", "Enter");
      else await page.click("#run");
    });
    assert.equal(sent.filter(({ url }) => url.includes("/v1/jobs")).length, 1, run);
  }
  assert.deepEqual(page.failures, []);
}

export async function races() {
  const page = await opened();
  await began(page);
  // Of two pictures the last one wins, however long the first takes.
  const transfer = await page.evaluateHandle(([bytes]) => {
    const of = (name, type, content) => {
      const transfer = new DataTransfer();
      transfer.items.add(new File([Uint8Array.from(content)], name, { type }));
      return transfer;
    };
    return of("first.ppm", "image/x-portable-pixmap", bytes);
  }, [[...noise(150, "first.ppm").buffer]]);
  await page.dispatchEvent("body", "drop", { dataTransfer: transfer });
  await page.setInputFiles("#file", PICTURE);
  assert.equal(await finished(page), 2949);
  await page.waitForTimeout(500);
  assert.equal(await page.evaluate(() => `${studio.source.name} ${studio.stage.renderer.width}`), "picture.png 384");
  // While one comes, nothing of the one before is shown, and the picture is.
  await page.evaluate(() => studio.setSize(100));
  await page.route("**/v1/jobs?**", async (route) => {
    await new Promise((resolve) => setTimeout(resolve, 1200));
    // What is cancelled meanwhile does not go on.
    await route.continue().catch(() => {});
  });
  await page.click("[data-sample=bloom]");
  await page.waitForFunction(() => studio.source.sample === "bloom" && studio.source.bitmap);
  await page.waitForTimeout(100);
  assert.equal(await page.textContent("#figure-vertices"), "–");
  assert.equal(await page.textContent("#figure-psnr"), "");
  assert.ok(await page.isVisible("#progress"));
  assert.match(await page.textContent("#progress-stage"), /Sen/);
  assert.ok(await page.isDisabled("#size-slider"));
  // And it can be stopped at once.
  await page.click("#cancel-button");
  assert.equal(await page.evaluate(() => studio.machine.phase), "cancelled");
  await page.unroute("**/v1/jobs?**");
  await page.click("#run");
  await finished(page);
  // One vertex down is at most a tenth down.
  await page.evaluate(() => studio.setSize(1000));
  await page.focus("#stage");
  await page.keyboard.press("[");
  await settled(page);
  assert.equal(await page.textContent("#figure-vertices"), "909");
  await page.keyboard.press("]");
  await settled(page);
  assert.equal(await page.textContent("#figure-vertices"), "1,000");
  await setSize(page, 99999999);
  assert.notEqual(await page.inputValue("#size-number"), "99999999");
  // Back leads to the picture before.
  await page.goBack();
  await page.waitForFunction(() => studio.source.name === "picture.png");
  await finished(page);
  assert.deepEqual(page.failures, []);
}

export async function elsewhere() {
  const page = await opened();
  await choose(page);
  const address = await page.textContent("#address");
  const id = new URL(address).searchParams.get("job");
  // Another browser has the original from the service, and can go on with it.
  const other = await opened(address.slice(service.length));
  await finished(other);
  await other.waitForFunction(() => studio.source.bitmap);
  assert.equal(await other.evaluate(() => studio.machine.phase), "ready");
  assert.ok(await other.isEnabled("#split-button"));
  await method(other, "med");
  await other.waitForFunction(() => studio.tracks[0].parameters.method === "med");
  await finished(other);
  // A job whose picture is not kept says so, and offers nothing that needs it.
  const made = await fetch(`${service}/v1/jobs?size=200`, { method: "POST", body: await (await fetch(`${service}/v1/jobs/${id}/image`)).arrayBuffer() });
  const bare = await opened(`/?job=${(await made.json()).id}`);
  await finished(bare);
  assert.equal(await bare.evaluate(() => studio.machine.phase), "missing");
  assert.match(await bare.textContent("#picture-note"), /original picture is not here/);
  for (const selector of ["#split-button", "#blink-button", "input[name=layer][value=original]", "input[name=layer][value=error]"]) {
    assert.ok(await bare.isDisabled(selector), selector);
  }
  await bare.click("#run");
  await bare.waitForSelector("#failure:not([hidden])");
  assert.match(await bare.textContent("#failure"), /Choose its file/);
  // A job that there is none of leaves no picture of one pixel.
  const none = await opened("/?job=01a20fe7-ee2f-7744-87bd-a0ba06725b2d");
  await none.waitForSelector("#failure:not([hidden])");
  assert.match(await none.textContent("#failure"), /its link has ended/);
  assert.ok(await none.isVisible("#empty"));
  assert.deepEqual([...page.failures, ...other.failures, ...bare.failures, ...none.failures], []);
}
