// What people want to make: outcomes, looks, weights, files as they are seen.

import { strict as assert } from "node:assert";
import { readFileSync } from "node:fs";
import { bytesOf, choose, chosen, finished, opened, setSize, settled, sprite } from "../browser.mjs";

/** What the canvas shows as a whole: how much of it is covered, the spread of its light, and a sum. */
function look(page) {
  return page.evaluate(() => {
    const { stage } = studio;
    stage.draw();
    const { width, height } = stage.canvas;
    const pixels = new Uint8Array(4 * width * height);
    stage.renderer.gl.readPixels(0, 0, width, height, stage.renderer.gl.RGBA, stage.renderer.gl.UNSIGNED_BYTE, pixels);
    let sum = 0, covered = 0, dark = 255, bright = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      sum = (sum * 31 + pixels[i]) % 1000003;
      if (pixels[i + 3] === 0) continue;
      covered++;
      [dark, bright] = [Math.min(dark, pixels[i]), Math.max(bright, pixels[i])];
    }
    return { covered: covered / (width * height), dark, bright, sum };
  });
}

/** Heights in 16 bits that use a sixtieth of the range. */
function heights(side) {
  const head = Buffer.from(`P5\n${side} ${side}\n65535\n`);
  const body = Buffer.alloc(2 * side * side);
  for (let i = 0; i < side * side; i++) {
    const x = i % side, y = Math.floor(i / side);
    body.writeUInt16BE(Math.round(300 + 500 * (1 + Math.sin(x / 9) * Math.cos(y / 11))), 2 * i);
  }
  return { name: "heights.pgm", mimeType: "image/x-portable-graymap", buffer: Buffer.concat([head, body]) };
}

export async function outcomes() {
  const page = await opened();
  await choose(page);
  const names = await page.locator("#presets button").evaluateAll((all) => all.map(({ dataset }) => dataset.preset));
  assert.deepEqual(names, ["photo", "lowpoly", "glass", "print", "terrain", "sprite", "logo", "placeholder", "draft"]);
  // Each has a thumbnail of this very picture, unlike the others.
  await page.waitForFunction(() => [...document.querySelectorAll("#presets canvas")].every((canvas) => canvas.getContext("2d").getImageData(0, 0, 112, 84).data.some(Boolean)));
  const thumbnails = await page.locator("#presets canvas").evaluateAll((all) => all.map((canvas) => canvas.toDataURL()));
  assert.equal(new Set(thumbnails).size, names.length);
  assert.equal(await page.getAttribute("[data-preset=photo]", "aria-pressed"), "true");
  // Words before figures, and no method's name before Advanced.
  assert.match(await page.textContent("#figure-likeness"), /Hard to tell apart|identical/);
  for (const text of await page.locator("main :is(button, label, p, dt, h2):visible").allTextContents()) assert.doesNotMatch(text, /mgprfs|PSNR|density/i);
  await page.click("[data-preset=lowpoly]");
  await page.waitForFunction(() => studio.tracks[0].parameters.method === "flat");
  assert.equal(await finished(page), 600);
  // One size at a time: the slider makes another when it is let go.
  await page.focus("#size-slider");
  await page.locator("#size-slider").evaluate((slider) => {
    slider.value = String(Number(slider.value) - 100);
    slider.dispatchEvent(new Event("input"));
    slider.dispatchEvent(new Event("change"));
  });
  await page.waitForFunction(() => studio.machine.hasMesh && studio.tracks[0].size < 500 && studio.tracks[0].size > 50);
  await page.click("[data-preset=terrain]");
  await page.waitForFunction(() => studio.stage.scene.relief && studio.stage.renderer.relief.count > 0);
  assert.equal(await page.inputValue("#solid-color"), "hillshade");
  // A picture of few colours and one with alpha get what suits them.
  const again = await opened();
  await choose(again, sprite(80));
  assert.equal(await again.evaluate(() => studio.source.bitmap !== null), true);
  assert.deepEqual([...page.failures, ...again.failures], []);
}

export async function solids() {
  const page = await opened();
  await choose(page);
  await page.click("#relief-button");
  const shown = () => page.waitForFunction(() => {
    const { relief } = studio.stage.renderer;
    return relief.count > 0 && relief.count === 3 * studio.tracks[0].faceCount;
  });
  await shown();
  // It follows the size and the picture.
  await setSize(page, 300);
  await shown();
  assert.ok(await page.isDisabled("#wireframe-button") && await page.isDisabled("#split-button") && await page.isDisabled("#zoom-one"));
  // What is taken is what is seen: as high, in the same colours.
  await page.fill("#height-range", "20");
  await page.selectOption("#solid-color", "hillshade");
  await page.click("#download-button");
  const [download] = await Promise.all([page.waitForEvent("download"), page.click("#export-dialog button[data-format=glb]")]);
  const glb = readFileSync(await download.path());
  const { accessors, meshes } = JSON.parse(glb.subarray(20, 20 + glb.readUInt32LE(12)));
  const { min, max } = accessors[meshes[0].primitives[0].attributes.POSITION];
  // The node turns them to y.
  const tall = max[2] - min[2];
  const luma = await page.evaluate(() => {
    const { values, vertexCount } = studio.stage.renderer.meshes[0].geometry;
    const lumas = Array.from({ length: vertexCount }, (_, v) => 0.299 * values[4 * v] + 0.587 * values[4 * v + 1] + 0.114 * values[4 * v + 2]);
    return (Math.max(...lumas) - Math.min(...lumas)) / 255;
  });
  assert.ok(Math.abs(tall - 0.2 * 384 * luma) < 0.02 * 384, `${tall} high`);
  // And with the picture itself as its texture.
  await page.check("#export-texture");
  const [textured] = await Promise.all([page.waitForEvent("download"), page.click("#export-dialog button[data-format=glb]")]);
  const model = readFileSync(await textured.path());
  assert.equal(JSON.parse(model.subarray(20, 20 + model.readUInt32LE(12))).images.length, 1);
  await page.uncheck("#export-texture");
  // Printers get millimetres.
  await page.fill("#export-width", "80");
  const [printed] = await Promise.all([page.waitForEvent("download"), page.click("#export-dialog button[data-format=stl]")]);
  const stl = readFileSync(await printed.path());
  let most = 0, least = Infinity;
  for (let at = 84; at < stl.length; at += 50) for (let k = 0; k < 3; k++) [most, least] = [Math.max(most, stl.readFloatLE(at + 12 + 12 * k)), Math.min(least, stl.readFloatLE(at + 12 + 12 * k))];
  assert.ok(Math.abs(most - least - 80) < 0.5, `${most - least} mm wide`);
  await page.keyboard.press("Escape");
  // Heights of few levels are seen, flat and in three dimensions, and another picture takes the place of the one before.
  await chosen(page, heights(120));
  await page.waitForFunction(() => studio.source.levels[0] > 0);
  await settled(page);
  const flat = await look(page);
  assert.ok(flat.bright - flat.dark > 200, JSON.stringify(flat));
  assert.equal(await page.evaluate(() => studio.stage.scene.relief), false);
  await page.click("[data-preset=terrain]");
  await page.waitForFunction(() => studio.machine.hasMesh && studio.stage.scene.relief);
  await shown();
  const hills = await look(page);
  assert.ok(hills.bright - hills.dark > 60 && hills.covered > 0.05, JSON.stringify(hills));
  // Where nothing is seen, nothing is cut in stone.
  await chosen(page, sprite(90));
  await page.evaluate(() => studio.stage.setRelief(true));
  await page.waitForFunction(() => studio.stage.renderer.relief.count > 0);
  assert.ok(await page.evaluate(() => studio.stage.renderer.relief.count < 3 * studio.tracks[0].faceCount));
  assert.deepEqual(page.failures, []);
}

export async function looks() {
  const page = await opened();
  await choose(page);
  await setSize(page, 400);
  const plain = await look(page);
  await page.evaluate(() => (document.getElementById("look-panel").open = true));
  await page.selectOption("#look-shading", "flat");
  await settled(page);
  const flat = await look(page);
  assert.notEqual(flat.sum, plain.sum);
  // Flat as the service makes it, for every size.
  const size = await page.evaluate(() => studio.tracks[0].size);
  const drawn = await bytesOf(page, () => studio.stage.renderer.readPicture(0));
  const expected = await bytesOf(page, async (size) => {
    const { decoded } = await import("/studio/decode.js");
    const path = `/v1/jobs/${studio.tracks[0].job.id}/mesh?size=${size}&format=png&reconstruction=flat`;
    return (await decoded(await (await fetch(path)).blob())).rgba;
  }, size);
  const near = drawn.filter((value, i) => Math.abs(value - expected[i]) <= 6).length / drawn.length;
  console.log(`flat faces: ${(100 * near).toFixed(1)} % of the samples within 6 levels of the service's`);
  assert.ok(near > 0.9);
  await page.selectOption("#look-colors", "palette");
  await page.fill("#look-count", "4");
  await page.fill("#look-edges", "1.5");
  await settled(page);
  await page.click("#download-button");
  const take = async (format) => {
    const [download] = await Promise.all([page.waitForEvent("download"), page.click(`#export-dialog button[data-format=${format}]`)]);
    return readFileSync(await download.path());
  };
  const svg = (await take("svg")).toString();
  assert.equal(new Set(svg.match(/fill="#[0-9a-f]{6}"/g)).size, 4);
  assert.match(svg, /stroke="#14110f" stroke-width="1.5"/);
  // Twice as large, drawn anew and not enlarged: with the look.
  await page.selectOption("#export-scale", "2");
  const png = await take("png");
  assert.deepEqual([png.readUInt32BE(16), png.readUInt32BE(20)], [768, 512]);
  const growing = (await take("svg-growing")).toString();
  assert.equal(growing.match(/<g class="f f\d+">/g).length, 24);
  await page.fill("#film-seconds", "1");
  const film = await take("film");
  console.log(`a film of ${film.length} bytes, an SVG of ${growing.length}`);
  assert.equal(film.readUInt32BE(0), 0x1a45dfa3, "WebM begins like this");
  assert.ok(film.length > 5000);
  await page.keyboard.press("Escape");
  // The address has the look.
  const other = await opened(new URL(page.url()).search ? `/${new URL(page.url()).search}` : "/");
  await finished(other);
  await settled(other);
  assert.deepEqual(await other.evaluate(() => studio.stage.scene.look), await page.evaluate(() => studio.stage.scene.look));
  await page.selectOption("#look-colors", "duotone");
  await settled(page);
  await page.click("#look-reset");
  await settled(page);
  assert.equal((await look(page)).sum, plain.sum);
  assert.deepEqual([...page.failures, ...other.failures], []);
}

export async function brush() {
  const page = await opened();
  await choose(page);
  const onTheLeft = () => page.evaluate(() => {
    const { xs, ranks } = studio.tracks[0].points;
    return xs.filter((x, v) => ranks[v] < 400 && x < 190).length;
  });
  const before = await onTheLeft();
  await page.click("#brush-button");
  await page.fill("#brush-size", "120");
  const box = await page.locator("#stage").boundingBox();
  const at = (share) => [box.x + box.width * (0.5 + share), box.y + box.height / 2];
  const stroke = async (from, to) => {
    await page.mouse.move(...at(from));
    await page.mouse.down();
    for (let i = 0; i < 3; i++) for (const share of [to, from]) await page.mouse.move(...at(share), { steps: 6 });
    await page.mouse.up();
  };
  await stroke(0.05, 0.25);
  await page.click("#brush-undo");
  assert.ok(await page.evaluate(() => studio.stage.weights.isPlain));
  await stroke(-0.25, -0.05);
  await page.check("#brush-less", { force: true });
  await stroke(0.05, 0.25);
  await page.waitForFunction(() => studio.source.weights && studio.machine.isBusy);
  await finished(page);
  const after = await onTheLeft();
  console.log(`${before} of the 400 first vertices on the left, ${after} once it is painted`);
  assert.ok(after > before + 30);
  // By the keyboard too, and away again.
  await page.focus("#stage");
  await page.keyboard.press("Space");
  await page.click("#brush-clear");
  await page.waitForFunction(() => studio.machine.hasMesh && studio.source.weights === null);
  assert.deepEqual(page.failures, []);
}
