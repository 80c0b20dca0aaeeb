// What is taken from the page: files, figures, addresses, commands, jobs of before.

import { strict as assert } from "node:assert";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { PICTURE, choose, finished, meshPath, method, opened, service, setSize, settled } from "../browser.mjs";

/** How the file of each format begins. */
const BEGINNINGS = {
  model: /^384 256 3 8\n(#.*\n)*OFF\n/, glb: /^glTF/, png: /^\x89PNG/, pnm: /^P6\n384 256/, gltf: /^\{"asset"/, svg: /^<(\?xml|svg)/, "svg-flat": /^<(\?xml|svg)/,
  ply: /^ply\n/, obj: /\nv 0 0 /, stl: /^[^]{84}/, json: /^\{"width":384/, pmesh: /^PMSH/, progression: /^PMSH/,
};

export async function downloads() {
  const page = await opened();
  const most = await choose(page);
  await setSize(page, 500);
  // Wherever the page is, it is in sight.
  await page.evaluate(() => scrollTo(0, 99999));
  const button = await page.locator("#download-button").boundingBox();
  assert.ok(button.y >= 0 && button.y + button.height <= 900, JSON.stringify(button));
  await page.click("#download-button");
  await page.waitForSelector("#export-dialog button[data-format]");
  const formats = await page.locator("#export-dialog button[data-format]").evaluateAll((cards) => cards.map((card) => card.dataset.format));
  const { formats: known } = await (await fetch(`${service}/v1/methods`)).json();
  // Quantized-mesh is for elevation models alone, which the page does not tell from pictures.
  for (const { format } of known) assert.ok(format === "terrain" || formats.includes(format), `no card for ${format}`);
  await page.waitForFunction(() => [...document.querySelectorAll("#export-dialog button[data-format] .size")].filter((size) => / k?B$/.test(size.textContent)).length >= 7);
  assert.ok(!(await page.locator("#export-dialog .size").allTextContents()).includes("0 B"));
  for (const format of formats.filter((format) => BEGINNINGS[format])) {
    // Chromium drops more than ten downloads in a second without a word.
    await page.waitForTimeout(150);
    const [download] = await Promise.all([page.waitForEvent("download"), page.click(`#export-dialog button[data-format=${format}]`)]);
    const bytes = readFileSync(await download.path());
    assert.match(bytes.toString("latin1"), BEGINNINGS[format]);
    assert.match(download.suggestedFilename(), format === "progression" ? /^picture-all-sizes\.pmesh$/ : /^picture-500\./);
    if (format === "model") assert.match(bytes.toString("latin1"), /\nOFF\n500 /);
    if (format === "json") assert.equal(JSON.parse(bytes).vertices, 500);
  }
  assert.ok(most > 500);
  assert.deepEqual(page.failures, []);
}

/** What is shown anew between the press and the release of a button takes no click away. */
export async function pressed() {
  const page = await opened();
  await choose(page);
  const pressed = "#history button[aria-label^=Forget]";
  await page.locator(pressed).first().scrollIntoViewIfNeeded();
  await page.locator(pressed).first().hover();
  await page.mouse.down();
  await page.evaluate(() => studio.onSettled());
  const before = await page.locator("#history .open").count();
  await page.mouse.up();
  await page.waitForFunction((count) => document.querySelectorAll("#history .open").length < count, before);
}

export async function compare() {
  const page = await opened();
  await choose(page);
  await page.evaluate(() => (document.getElementById("advanced").open = true));
  await page.selectOption("#compared-select", "med");
  await page.waitForFunction(() => {
    const { tracks } = studio;
    return tracks.every(({ stage, size }) => stage === "final" && size > 0);
  });
  await settled(page);
  assert.match(await page.textContent("#label-a"), /A: optimal/);
  assert.match(await page.textContent("#label-b"), /B: med/);
  // Both move with the slider.
  await setSize(page, 640);
  const sizes = await page.evaluate(async () => studio.tracks.map(({ size }) => size));
  assert.deepEqual(sizes, [640, 640]);
  const cells = await page.locator("#numbers tbody tr").evaluateAll((rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));
  const rows = Object.fromEntries(cells.map(([name, ...values]) => [name, values]));
  assert.deepEqual(rows.Method, ["optimal", "med"]);
  assert.deepEqual(rows.Vertices, ["640", "640"]);
  const [a, b] = rows["Likeness (PSNR)"].map((text) => Number.parseFloat(text));
  assert.ok(a > b, `${a} dB of optimal, ${b} dB of med`);
  await page.evaluate(() => (document.getElementById("numbers-panel").open = true));
  await page.click("#copy-numbers");
  const copied = await page.evaluate(() => navigator.clipboard.readText());
  assert.match(copied, /^Figure\tA\tB\nMethod\toptimal\tmed\nVertices\t640\t640\n/);
  // Both are drawn, each in its half.
  const drawn = await page.evaluate(async () => {
    const { renderer } = studio.stage;
    return [0, 1].map((side) => renderer.readPicture(side).reduce((sum, value) => sum + value, 0));
  });
  assert.ok(drawn[0] > 0 && drawn[1] > 0 && drawn[0] !== drawn[1]);
  assert.equal(await page.locator("#curve .line").count(), 2);
  await page.selectOption("#compared-select", "");
  await finished(page);
  assert.ok(await page.isHidden("#label-b"));
  assert.deepEqual(page.failures, []);
}

export async function again() {
  const page = await opened("/?sample=bloom&method=med&density=1");
  const most = await finished(page);
  assert.equal(await page.inputValue("#method-select"), "med");
  assert.ok(Math.abs(most - 3072) <= 14, String(most));
  await setSize(page, 700);
  await page.check("input[name=layer][value=error]", { force: true });
  await page.click("#points-button");
  await page.click("#zoom-in");
  await settled(page);
  const address = await page.textContent("#address");
  assert.equal(address, page.url());
  const figures = await page.textContent("#numbers");
  const other = await opened(address.slice(service.length));
  await finished(other);
  await settled(other);
  const untimed = (text) => text.replace(/Total time.*/s, "");
  assert.equal(untimed(await other.textContent("#numbers")), untimed(figures));
  assert.ok(await other.isChecked("input[name=layer][value=error]"));
  assert.equal(await other.getAttribute("#points-button", "aria-pressed"), "true");
  assert.equal(await other.textContent("#address"), address);
  await commandsWork();
  assert.deepEqual([...page.failures, ...other.failures], []);
}

/** The commands make the very pictures that the service has for the page. */
async function commandsWork() {
  const page = await opened();
  await choose(page);
  await setSize(page, 321);
  await page.waitForFunction(() => document.getElementById("curl").textContent.includes("size=321"));
  const folder = mkdtempSync(join(tmpdir(), "studio-"));
  try {
    const script = (await page.textContent("#curl")).replace("@'picture.png'", `@'${PICTURE}'`);
    assert.ok(dirname(PICTURE) && script.includes(PICTURE));
    execFileSync("sh", ["-ec", script], { cwd: folder });
    const path = await meshPath(page);
    for (const [file, asked] of [["mesh.png", "format=png"], ["mesh-321.png", "size=321&format=png"]]) {
      const expected = Buffer.from(await (await fetch(`${service}${path}?${asked}`)).arrayBuffer());
      assert.ok(readFileSync(join(folder, file)).equals(expected), file);
    }
  } finally {
    rmSync(folder, { recursive: true });
  }
}

export async function history() {
  const page = await opened();
  await choose(page);
  await page.waitForSelector("#history li:has-text('picture.png')");
  await method(page, "med");
  await page.waitForSelector("#history li:has-text('Fast, ')");
  await page.reload();
  await finished(page);
  const entries = page.locator("#history .open:has-text('picture.png')");
  assert.equal(await entries.count(), 2);
  await entries.filter({ hasText: "Best" }).click();
  await page.waitForFunction(() => studio.source.name === "picture.png");
  assert.equal(await finished(page), 2949);
  // Without the picture in the address, the job is.
  assert.match(page.url(), /job=[0-9a-f-]{36}/);
  // One that the service no longer has says so.
  const id = new URL(page.url()).searchParams.get("job");
  assert.equal((await fetch(`${service}/v1/jobs/${id}`, { method: "DELETE" })).status, 204);
  await entries.filter({ hasText: "Best" }).click();
  await page.waitForSelector("#failure:not([hidden])");
  assert.match(await page.textContent("#failure"), /Choose the picture again/);
  await page.locator("#history li:has-text('picture.png') button[aria-label^=Forget]").first().click();
  await page.waitForFunction(() => [...document.querySelectorAll("#history .open")].filter((e) => e.textContent.includes("picture.png")).length === 1);
  assert.deepEqual(page.failures, []);
}
