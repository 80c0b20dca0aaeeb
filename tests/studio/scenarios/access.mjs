// For everyone: keyboard, screen readers, narrow screens, light pages, keys.

import { strict as assert } from "node:assert";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { PICTURE, began, choose, chosen, finished, opened, settled } from "../browser.mjs";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

export async function keyboard() {
  const page = await opened();
  await choose(page);
  await page.focus("body");
  const names = [];
  for (let i = 0; i < 70; i++) {
    await page.keyboard.press("Tab");
    const name = await page.evaluate(() => {
      const at = document.activeElement;
      const box = at.getBoundingClientRect();
      return { id: at.id || at.textContent.trim().slice(0, 20), size: box.width * box.height };
    });
    if (names.includes(name.id)) break;
    names.push(name.id);
  }
  for (const id of ["Skip to the picture", "wireframe-button", "split-button", "relief-button", "zoom-fit", "stage", "size-slider", "size-number", "file", "amount", "run", "download-button", "brush-button"]) {
    assert.ok(names.includes(id), `${id} is not reached: ${names.join(", ")}`);
  }
  // The stage by its keys.
  await page.focus("#stage");
  const scene = () => page.evaluate(async () => ({ ...studio.stage.scene }));
  for (const [key, name, value] of [["e", "layer", "error"], ["l", "layer", "none"], ["m", "layer", "mesh"], ["w", "wireframe", true], ["w", "wireframe", false], ["p", "points", true], ["p", "points", false], ["s", "smooth", true], ["s", "smooth", false], ["x", "split", 0.5], ["x", "split", null]]) {
    await page.keyboard.press(key);
    assert.equal((await scene())[name], value, key);
  }
  const before = await scene();
  await page.keyboard.press("+");
  await page.keyboard.press("ArrowRight");
  const after = await scene();
  assert.ok(after.zoom > before.zoom && after.x > before.x);
  await page.keyboard.press("0");
  const size = () => page.evaluate(async () => studio.tracks[0].size);
  const most = await size();
  await page.keyboard.press("[");
  assert.ok((await size()) < most);
  await page.keyboard.press("]");
  assert.equal(await size(), most);
  // Layers by arrows, a dialog that closes, one of our pictures, a method.
  await page.focus("input[name=layer]:checked");
  await page.keyboard.press("ArrowRight");
  assert.equal((await scene()).layer, "original");
  await page.focus("#help-button");
  await page.keyboard.press("Enter");
  assert.ok(await page.isVisible("#help-dialog"));
  await page.keyboard.press("Escape");
  assert.ok(await page.isHidden("#help-dialog"));
  assert.equal(await page.evaluate(() => document.activeElement.id), "help-button");
  await page.focus("[data-sample=bloom]");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => studio.source.sample === "bloom");
  await finished(page);
  await page.evaluate(() => (document.getElementById("advanced").open = true));
  await page.focus("#method-select");
  await page.keyboard.press("ArrowUp");
  await page.waitForFunction(() => studio.tracks[0].parameters.method !== "optimal");
  assert.deepEqual(page.failures, []);
}

export async function axe() {
  for (const options of [{ colorScheme: "dark" }, { colorScheme: "light" }, { colorScheme: "dark", viewport: { width: 390, height: 844 } }, { path: "/?dir=rtl", colorScheme: "light" }]) {
    const page = await opened(options.path ?? "/", options);
    await choose(page);
    for (const state of ["as it comes", "everything open"]) {
      if (state === "everything open") {
        await page.click("#split-button");
        await page.check("input[name=layer][value=error]", { force: true });
        await page.evaluate(() => document.querySelectorAll("details").forEach((details) => (details.open = true)));
        await page.setInputFiles("#file", { name: "poem.png", mimeType: "image/png", buffer: Buffer.from("no") });
        await page.waitForSelector("#failure:not([hidden])");
      }
      // Colours change over a moment.
      await page.waitForTimeout(400);
      await page.evaluate(AXE);
      const { violations, passes } = await page.evaluate(() => globalThis.axe.run());
      assert.ok(passes.length > 20);
      const found = violations.map(({ id, impact, nodes }) => `${impact} ${id}: ${nodes.map(({ html, failureSummary }) => `${html.slice(0, 120)} ${failureSummary}`).join(" | ")}`);
      console.log(`${JSON.stringify(options)} ${state}: ${passes.length} rules hold, ${found.length} do not`);
      assert.deepEqual(found, []);
    }
    const isNarrow = options.viewport?.width < 640;
    await choose(page);
    for (const [button, dialog] of [["#download-button", "#export-dialog"], ...(isNarrow ? [] : [["#help-button", "#help-dialog"], ["#key-button", "#key-dialog"]])]) {
      await page.click(button);
      const { violations } = await page.evaluate((dialog) => globalThis.axe.run(dialog), dialog);
      assert.deepEqual(violations.map(({ id }) => id), []);
      await page.keyboard.press("Escape");
    }
    await page.context().close();
  }
}

export async function narrow() {
  for (const path of ["/", "/?dir=rtl"]) {
    const page = await opened(path, { viewport: { width: 360, height: 740 }, hasTouch: true, isMobile: true });
    await choose(page);
    const { room, needed } = await page.evaluate(() => ({ room: document.documentElement.clientWidth, needed: document.documentElement.scrollWidth }));
    assert.ok(needed <= room, `${needed} pixels in ${room}`);
    for (const id of ["stage", "size-slider", "amount", "run"]) {
      const box = await page.locator(`#${id}`).boundingBox();
      assert.ok(box.x >= 0 && box.x + box.width <= 361, `${id}: ${JSON.stringify(box)}`);
    }
    // What begins and what ends the journey are in sight wherever the page is, and as large as a thumb.
    for (const top of [0, 9999]) {
      await page.evaluate((top) => scrollTo(0, top), top);
      for (const id of ["choose-button", "download-button"]) {
        const box = await page.locator(`#${id}`).boundingBox();
        assert.ok(box.y > 0 && box.y + box.height <= 740 && box.height >= 44, `${id}: ${JSON.stringify(box)}`);
      }
    }
    // A picture that is chosen is in sight, and a swipe over it scrolls.
    await page.evaluate(() => scrollTo(0, 9999));
    await chosen(page, PICTURE);
    const stage = await page.locator("#stage-box").boundingBox();
    assert.ok(stage.y > -stage.height / 2 && stage.y < 500, JSON.stringify(stage));
    assert.equal(await page.locator("#stage").evaluate((canvas) => canvas.style.touchAction), "pan-y");
    // Where it is read from the right, the panels and figures are too.
    if (path.includes("rtl")) {
      const [first, last] = await page.locator(".figures div").evaluateAll((boxes) => boxes.slice(0, 2).map((box) => box.getBoundingClientRect().left));
      assert.ok(first > last);
    }
    const small = await page.locator(".toolbar button:visible, .segments span:visible").evaluateAll((all) => all.filter((e) => e.getBoundingClientRect().height < 44).length);
    assert.equal(small, 0, "targets for fingers are 44 pixels high at least");
    assert.deepEqual(page.failures, []);
    await page.context().close();
  }
}

export async function weight() {
  const page = await opened("/docs");
  const sizes = [];
  const elsewhere = [];
  page.on("response", async (response) => {
    const { pathname, origin, protocol } = new URL(response.url());
    if (protocol.startsWith("http") && origin !== process.argv[3]) elsewhere.push(response.url());
    if (pathname === "/" || pathname.startsWith("/studio/")) sizes.push(response.request().sizes().then(({ responseBodySize, responseHeadersSize }) => [pathname, responseBodySize + responseHeadersSize]));
  });
  await page.addInitScript(() => {
    globalThis.shifts = [];
    globalThis.violations = [];
    new PerformanceObserver((list) => globalThis.shifts.push(...list.getEntries().filter(({ hadRecentInput }) => !hadRecentInput).map(({ value, sources }) => ({ value, of: sources.map(({ node }) => node?.id || node?.className || node?.textContent?.slice(0, 30)) })))).observe({ type: "layout-shift", buffered: true });
    document.addEventListener("securitypolicyviolation", ({ violatedDirective, blockedURI }) => globalThis.violations.push(`${violatedDirective} ${blockedURI}`));
  });
  await page.goto(process.argv[3]);
  await began(page);
  await page.waitForFunction(() => studio.stage.renderer.meshes[0]);
  await settled(page);
  const all = await Promise.all(sizes);
  const total = all.reduce((sum, [, size]) => sum + size, 0);
  console.log(`${all.length} files, ${total} bytes with their headers`);
  assert.ok(all.length > 20 && total < 150_000, JSON.stringify(all));
  const { shifts, violations } = await page.evaluate(() => ({ shifts: globalThis.shifts, violations: globalThis.violations }));
  const jump = shifts.reduce((sum, { value }) => sum + value, 0);
  console.log(`layout shift ${jump.toFixed(4)}`);
  assert.ok(jump < 0.02, JSON.stringify(shifts));
  assert.deepEqual([violations, elsewhere, page.failures], [[], [], []]);
}

export async function keys(key) {
  const page = await opened();
  // The first picture needs no key, and what needs one asks by itself.
  await page.waitForSelector("#key-dialog[open]");
  assert.equal(await page.textContent("#figure-vertices"), "600");
  await page.keyboard.press("Escape");
  await page.setInputFiles("#file", PICTURE);
  await page.waitForSelector("#key-dialog[open]");
  await page.waitForFunction(() => studio.source.bitmap);
  await page.fill("#key-input", "wrong");
  await page.click("#key-dialog button[value=save]");
  await page.waitForFunction(() => studio.machine.phase === "failed" && document.getElementById("key-dialog").open);
  await page.fill("#key-input", key);
  await page.click("#key-dialog button[value=save]");
  // The picture that was chosen goes on.
  assert.equal(await finished(page), 2949);
  assert.ok(await page.isHidden("#failure"));
  assert.ok(!(await page.textContent("#curl")).includes(key), "the key is not shown");
  await page.click("#download-button");
  const [download] = await Promise.all([page.waitForEvent("download"), page.click("#export-dialog button[data-format=png]")]);
  assert.equal(download.suggestedFilename(), "picture-2949.png");
  assert.deepEqual(page.failures, []);
}
