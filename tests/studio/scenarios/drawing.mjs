// What is drawn, pixel by pixel, and how long a frame takes.

import { strict as assert } from "node:assert";
import { bytesOf, choose, finished, grayPicture, largestDifference, largestSeenDifference, meshPath, opened, picturePixels, setSize, settled, sprite } from "../browser.mjs";

/** What the canvas shows in a rectangle, rows from the bottom, once it is drawn anew. */
function seen(page, place) {
  return bytesOf(page, ([x, y, width, height]) => {
    const { stage } = studio;
    stage.draw();
    const pixels = new Uint8Array(4 * width * height);
    stage.renderer.gl.readPixels(x, y, width, height, stage.renderer.gl.RGBA, stage.renderer.gl.UNSIGNED_BYTE, pixels);
    return pixels;
  }, place);
}

/** Where the whole picture is on the canvas at single pixels. */
async function atSinglePixels(page) {
  return page.evaluate(async () => {
    const { stage } = studio;
    stage.view.fit();
    stage.view.press("1");
    stage.draw();
    const { width, height } = stage.renderer;
    const { canvas, scene } = stage;
    return [Math.round(canvas.width / 2 - scene.x * scene.zoom), Math.round(canvas.height / 2 - scene.y * scene.zoom), width, height];
  });
}

const picture = (page) => bytesOf(page, () => studio.stage.renderer.readPicture(0));

export async function pixels() {
  const page = await opened();
  for (const file of [undefined, grayPicture(101, 77)]) {
    const most = await choose(page, file);
    const path = await meshPath(page);
    for (const size of [most, Math.round(most / 5), 9, 4]) {
      await setSize(page, size);
      const expected = await picturePixels(page, `${path}?size=${size}&format=png`);
      const drawn = await picture(page);
      const texture = largestDifference(drawn, expected);
      const place = await atSinglePixels(page);
      const screen = largestDifference(await seen(page, place), expected);
      const unequal = drawn.filter((value, i) => value !== expected[i]).length;
      console.log(`${size} vertices: at most ${texture} level in the texture, ${screen} on the canvas; ${unequal} of ${drawn.length} samples differ`);
      assert.ok(texture <= 1 && screen <= 1);
    }
  }
  const most = await choose(page, sprite(90));
  const path = await meshPath(page);
  for (const size of [most, Math.round(most / 4), 12]) {
    await setSize(page, size);
    const difference = largestSeenDifference(await picture(page), await picturePixels(page, `${path}?size=${size}&format=png`));
    console.log(`sprite of ${size} vertices: at most ${difference} level`);
    assert.ok(difference <= 1);
  }
  assert.deepEqual(page.failures, []);
  const flat = await opened("/?sample=spheres&method=flat&size=500");
  await finished(flat);
  const expected = await picturePixels(flat, `${await meshPath(flat)}?format=png`);
  const drawn = await picture(flat);
  // A pixel on an edge may have the colour of the other face.
  const equal = drawn.filter((value, i) => value === expected[i]).length / drawn.length;
  console.log(`faces with colours: ${(100 * equal).toFixed(1)} % of the samples are equal`);
  assert.ok(equal > 0.85);
  assert.deepEqual(flat.failures, []);
}

export async function layers() {
  const page = await opened();
  await choose(page);
  await setSize(page, 300);
  const place = await atSinglePixels(page);
  const original = await bytesOf(page, () => studio.source.bitmap.rgba);
  const mesh = await picture(page);
  const layer = async (name) => {
    await page.check(`input[name=layer][value=${name}]`, { force: true });
    if (name === "density") await page.waitForFunction(() => studio.stage.renderer.hasDensity);
    await settled(page);
    return seen(page, place);
  };
  assert.equal(largestDifference(await layer("original"), original), 0);
  // The heat of the error is as dark as the error is small.
  const heat = await layer("error");
  assert.ok(await page.isVisible("#scale"));
  const light = (pixels, i) => pixels[4 * i] + pixels[4 * i + 1] + pixels[4 * i + 2];
  const error = (i) => Math.max(...[0, 1, 2].map((k) => Math.abs(original[4 * i + k] - mesh[4 * i + k])));
  let exact = 0, large = 0;
  for (let i = 0; i < heat.length / 4; i++) {
    if (error(i) === 0) {
      exact++;
      assert.ok(light(heat, i) < 40, `exact, but ${light(heat, i)}`);
    } else if (error(i) >= 32) {
      large++;
      assert.ok(light(heat, i) > 640, `an error of ${error(i)}, but ${light(heat, i)}`);
    }
  }
  assert.ok(exact > 100 && large > 100, `${exact} exact, ${large} large`);
  // The scale is in levels.
  await page.fill("#scale-range", "255");
  assert.equal(await page.textContent("#scale-high"), "255 levels");
  const wider = await seen(page, place);
  assert.ok(wider.reduce((sum, value) => sum + value, 0) < heat.reduce((sum, value) => sum + value, 0));
  await densityIsRight(await layer("density"), original, place);
  // Lines alone are the edges, though the wireframe is off.
  const lines = await layer("none");
  const bright = lines.filter((value, i) => i % 4 !== 3 && value > 60).length / lines.length;
  assert.ok(bright > 0.02 && bright < 0.7, `${bright} of the lines' samples are bright`);
  await layer("mesh");
  await marksAreSeen(page, place);
  await splitAndBlink(page, place, original, mesh);
  // Smooth triangles pass through the same values at the middles of pixels; only where several
  // triangles meet in one pixel are they mixed.
  await page.click("#smooth-button");
  const smooth = await seen(page, place);
  const mixed = smooth.filter((value, i) => Math.abs(value - mesh[i]) > 1).length / smooth.length;
  console.log(`smooth triangles mix ${(100 * mixed).toFixed(1)} % of the samples`);
  assert.ok(mixed < 0.1);
  assert.deepEqual(page.failures, []);
}

/** The density map is brightest where the filter of the method is strongest. */
function densityIsRight(map, original, [, , width, height]) {
  const at = (x, y, c) => (x < 0 || y < 0 || x >= width || y >= height ? 0 : original[4 * (y * width + x) + c]);
  const response = (x, y) => {
    let most = 0;
    for (let c = 0; c < 3; c++) {
      const smooth = (u, v) => {
        let sum = 0;
        for (const [dx, dy, weight] of [[-1, -1, 1], [0, -1, 2], [1, -1, 1], [-1, 0, 2], [0, 0, 4], [1, 0, 2], [-1, 1, 1], [0, 1, 2], [1, 1, 1]]) sum += weight * at(u + dx, v + dy, c);
        return sum / 16;
      };
      const xx = smooth(x - 1, y) - 2 * smooth(x, y) + smooth(x + 1, y);
      const yy = smooth(x, y - 1) - 2 * smooth(x, y) + smooth(x, y + 1);
      const xy = (smooth(x + 1, y + 1) - smooth(x - 1, y + 1) - smooth(x + 1, y - 1) + smooth(x - 1, y - 1)) / 4;
      most = Math.max(most, Math.abs((xx + yy) / 2) + Math.hypot((xx - yy) / 2, xy));
    }
    return most;
  };
  const places = [];
  let largest = 0;
  for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) largest = Math.max(largest, response(x, y));
  for (let i = 0; i < 400; i++) places.push([(i * 7919) % width, (i * 104729) % height]);
  const light = (x, y) => map[4 * (y * width + x)] + map[4 * (y * width + x) + 1] + map[4 * (y * width + x) + 2];
  const bySpec = places.map(([x, y]) => ({ density: Math.round(255 * Math.sqrt(response(x, y) / largest)), light: light(x, y) }));
  bySpec.sort((a, b) => a.density - b.density);
  for (let i = 1; i < bySpec.length; i++) {
    // The colours grow lighter from step to step; a step may be rounded either way.
    if (bySpec[i].density > bySpec[i - 1].density + 2) assert.ok(bySpec[i].light >= bySpec[i - 1].light - 6, JSON.stringify([bySpec[i - 1], bySpec[i]]));
  }
  assert.ok(bySpec.at(-1).light > bySpec[0].light + 60);
}

async function marksAreSeen(page, place) {
  const plain = await seen(page, place);
  const changed = async (button) => {
    await page.click(button);
    assert.equal(await page.getAttribute(button, "aria-pressed"), "true");
    const marked = await seen(page, place);
    await page.click(button);
    return marked.filter((value, i) => value !== plain[i]).length / plain.length;
  };
  const edges = await changed("#wireframe-button"), points = await changed("#points-button");
  console.log(`the wireframe changes ${(100 * edges).toFixed(1)} % of the samples, the points ${(100 * points).toFixed(1)} %`);
  assert.ok(edges > 0.05 && edges < 0.6 && points > 0.005 && points < 0.3);
}

async function splitAndBlink(page, place, original, mesh) {
  await page.click("#split-button");
  const [, , width] = place;
  const halves = await seen(page, place);
  const column = (i) => Math.floor(i / 4) % width;
  const left = halves.filter((value, i) => column(i) < width / 2 - 2 && value !== original[i]).length;
  const right = halves.filter((value, i) => column(i) > width / 2 + 2 && i % 4 !== 3 && Math.abs(value - mesh[i]) > 1).length;
  assert.deepEqual([left, right], [0, 0]);
  // The label says what is on the right, and the line is dragged wherever it is taken hold of.
  await page.keyboard.press("Escape");
  await page.check("input[name=layer][value=error]", { force: true });
  await settled(page);
  assert.equal(await page.textContent("#label-b"), "differences");
  await page.check("input[name=layer][value=mesh]", { force: true });
  const line = await page.locator("#divider-line").boundingBox();
  await page.mouse.move(line.x + 2, line.y + 60);
  await page.mouse.down();
  await page.mouse.move(line.x - 98, line.y + 60, { steps: 2 });
  await page.mouse.up();
  const dragged = await page.evaluate(() => [studio.stage.scene.split, studio.stage.canvas.clientWidth, studio.stage.view.isFitted]);
  assert.ok(Math.abs((0.5 - dragged[0]) * dragged[1] - 100) < 16, String(dragged));
  await page.locator("#divider").press("End");
  assert.equal(largestDifference(await seen(page, place), original), 0);
  await page.click("#split-button");
  await page.click("#blink-button");
  const looks = new Set();
  for (let i = 0; i < 40; i++) {
    looks.add(await page.evaluate(async () => studio.stage.isOriginal));
    await page.waitForTimeout(50);
  }
  assert.equal(looks.size, 2);
  await page.click("#blink-button");
  assert.ok(largestDifference(await seen(page, place), mesh) <= 1);
}

export async function relief() {
  const page = await opened();
  await choose(page);
  await page.click("#relief-button");
  await page.waitForFunction(() => studio.stage.renderer.relief.count > 0);
  const look = () => page.evaluate(async () => {
    const { stage } = studio;
    stage.draw();
    const { width, height } = stage.canvas;
    const pixels = new Uint8Array(4 * width * height);
    stage.renderer.gl.readPixels(0, 0, width, height, stage.renderer.gl.RGBA, stage.renderer.gl.UNSIGNED_BYTE, pixels);
    let sum = 0, covered = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      covered += pixels[i + 3] > 0 ? 1 : 0;
      sum = (sum * 31 + pixels[i]) % 1000003;
    }
    return { covered: covered / (width * height), sum };
  });
  const first = await look();
  assert.ok(first.covered > 0.1 && first.covered < 0.95, JSON.stringify(first));
  const box = await page.locator("#stage").boundingBox();
  await page.mouse.move(box.x + 300, box.y + 200);
  await page.mouse.down();
  await page.mouse.move(box.x + 380, box.y + 220, { steps: 4 });
  await page.mouse.up();
  const turned = await look();
  assert.notEqual(turned.sum, first.sum);
  await page.fill("#height-range", "2");
  assert.notEqual((await look()).sum, turned.sum);
  await page.focus("#stage");
  await page.keyboard.press("3");
  assert.equal(await page.getAttribute("#relief-button", "aria-pressed"), "false");
  assert.deepEqual(page.failures, []);
  const flat = await opened("/?sample=spheres&method=flat&size=500&compression=meshopt&relief=1");
  await flat.waitForFunction(() => globalThis.studio?.stage.renderer.relief?.count > 0);
  assert.deepEqual(flat.failures, []);
}

/** How often a picture of 3 megapixels is drawn as a whole while its mesh changes, and once the hand rests. */
function draggedWork(page) {
  return page.evaluate(async () => {
    const { stage, stage: { renderer, scene, view } } = studio;
    const geometry = renderer.meshes[0].geometry;
    renderer.setSize(2000, 1500);
    stage.toggle("smooth", false);
    view.fit();
    let count = 0;
    const { drawPicture } = renderer;
    renderer.drawPicture = function (side) {
      if (this.meshes[side] && !this.meshes[side].isPictured) count++;
      drawPicture.call(this, side);
    };
    scene.moves = true;
    for (let i = 0; i < 8; i++) {
      renderer.setMesh(0, geometry, 8);
      stage.draw();
    }
    const moving = count;
    scene.moves = false;
    for (let i = 0; i < 3; i++) stage.draw();
    return { moving, atRest: count - moving };
  });
}

export async function frames() {
  const page = await opened("/?sample=lake&size=300");
  await finished(page);
  assert.deepEqual(await draggedWork(page), { moving: 0, atRest: 1 });
  const measured = await page.evaluate(async () => {
    const { triangulate } = await import("/studio/triangulate.js");
    const { geometryOf } = await import("/studio/geometry.js");
    // Distinct lattice points by row, then column, with the corners.
    const width = 1000, height = 800, count = 100_700;
    const places = new Set([0, width - 1, (height - 1) * width, height * width - 1]);
    for (let i = 1; places.size < count; i++) places.add((i * 389_171) % (width * height));
    const sorted = Float64Array.from(places).sort();
    const xs = Int32Array.from(sorted, (place) => place % width), ys = Int32Array.from(sorted, (place) => Math.floor(place / width));
    const samples = Uint16Array.from({ length: 3 * count }, (_, i) => (i * 37) % 256);
    const points = { width, height, components: 3, precision: 8, xs, ys, samples, ranks: null, squaredErrors: null };
    const began = performance.now();
    const geometry = geometryOf(points, triangulate(xs, ys));
    const triangulated = performance.now() - began;
    const { renderer, view } = studio.stage;
    renderer.setSize(width, height);
    renderer.setMesh(0, geometry, 8);
    renderer.drawPicture(0);
    view.fit();
    studio.stage.toggle("wireframe", true);
    studio.stage.toggle("smooth", true);
    const own = [], between = [];
    let last = await new Promise(requestAnimationFrame);
    for (let i = 0; i < 40; i++) {
      view.zoomAt(1.01);
      view.pan(i % 2 ? 9 : -7, 3);
      const at = await new Promise(requestAnimationFrame);
      // The frame that was asked for has been drawn before this one.
      own.push(renderer.frameMs);
      between.push(at - last);
      last = at;
    }
    const middle = (values) => values.sort((a, b) => a - b)[values.length >> 1];
    return { faces: geometry.faceCount, triangulated, own: middle(own), worst: own.at(-1), between: middle(between) };
  });
  const { faces, triangulated, own, worst, between } = measured;
  console.log(`${faces} triangles: ${own.toFixed(2)} ms of JavaScript a frame (median of 40; ${worst.toFixed(2)} ms at most), ` +
    `${between.toFixed(1)} ms from frame to frame with graphics in software; triangulated in ${triangulated.toFixed(0)} ms`);
  assert.ok(faces >= 200_000);
  assert.deepEqual(page.failures, []);
}
