// Tests of the installed package against a running service: PIXMESH_URL, and PICTURE in colour.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { Client, ServiceError, buffersOf, facesOf, psnrOf, readModel, readPmesh } from "pixmesh-client";

const client = new Client({ url: process.env.PIXMESH_URL });
const picture = await readFile(process.env.PICTURE);
const text = (answer) => new TextDecoder().decode(answer.bytes);
const size = { size: 300 };

test("a pmesh gives the points and faces of the MODEL", async () => {
  const points = await readPmesh((await client.mesh(picture, { ...size, format: "pmesh" })).bytes);
  const model = readModel(text(await client.mesh(picture, size)));
  for (const name of ["width", "height", "components", "precision", "xs", "ys", "samples"]) {
    assert.deepEqual(points[name], model[name], name);
  }
  const triangles = (faces) => Array.from({ length: faces.length / 3 }, (_, f) => {
    const [a, b, c] = faces.subarray(3 * f, 3 * f + 3);
    const least = Math.min(a, b, c);
    return (a === least ? [a, b, c] : b === least ? [b, c, a] : [c, a, b]).join();
  }).sort();
  assert.deepEqual(triangles(facesOf(points)), triangles(model.faces));
});

test("a progression of an elevation model has a text behind its header", async () => {
  const bytes = new Uint8Array((await client.mesh(picture, { ...size, format: "progression" })).bytes);
  const text = new TextEncoder().encode("elevation model: base 0 step 1 rounding 0 unit 1");
  const model = Uint8Array.from([...bytes.subarray(0, 24), text.length, 0, ...text, ...bytes.subarray(24)]);
  model[4] = 4;
  assert.deepEqual(await readPmesh(model.buffer), await readPmesh(bytes.buffer));
});

test("a progression gives the mesh of every size, with its PSNR", async () => {
  const points = await client.progression(picture, size);
  const { psnr } = await client.mesh(picture, size);
  assert.ok(Math.abs(psnrOf(points, 300) - psnr) < 1e-9);
  for (const count of [4, 5, 120, 300]) {
    const { positions, colors, uvs, indices } = buffersOf(points, count);
    assert.deepEqual([positions.length, colors.length, uvs.length], [3 * count, 4 * count, 2 * count]);
    // The faces are counter-clockwise and cover the picture once.
    let twice = 0;
    for (let f = 0; f < indices.length; f += 3) {
      const [a, b, c] = indices.subarray(f, f + 3);
      const at = (v) => positions.subarray(3 * v, 3 * v + 2);
      const [[ax, ay], [bx, by], [cx, cy]] = [at(a), at(b), at(c)];
      const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
      assert.ok(area > 0);
      twice += area;
    }
    assert.equal(twice, 2 * (points.width - 1) * (points.height - 1));
  }
  assert.throws(() => buffersOf(points, 3), RangeError);
});

test("buffers of one colour for each face have three vertices for each", async () => {
  const model = readModel(text(await client.mesh(picture, { preset: "lowpoly", size: 60, format: "model" })));
  const { positions, colors, indices } = buffersOf(model);
  assert.equal(positions.length, 3 * model.faces.length);
  assert.deepEqual([...colors.subarray(0, 3)], [...model.faceSamples.subarray(0, 3)]);
  assert.deepEqual([...indices.subarray(0, 4)], [0, 1, 2, 3]);
});

test("a job is followed to its end, and its mesh is the same", async () => {
  const { id } = await client.submit(picture, size, { idempotencyKey: crypto.randomUUID() });
  const states = [];
  for await (const { state } of client.follow(id)) states.push(state);
  assert.equal(states.at(-1), "completed");
  assert.equal((await client.job(id)).state, "completed");
  const kept = await client.meshOf(id, { format: "glb" });
  const made = await client.mesh(picture, { ...size, format: "glb" });
  assert.deepEqual(kept.bytes, made.bytes);
  assert.deepEqual([kept.vertices, kept.faces, kept.psnr], [made.vertices, made.faces, made.psnr]);
  await client.cancel(id);
  await assert.rejects(client.job(id), (error) => error instanceof ServiceError && error.slug === "not-found");
});

test("a plus and a sign before a colour arrive as they are", async () => {
  const made = await client.mesh(picture, { ...size, method: "med+", alpha: "over:#102030" });
  assert.match(made.parameters, /method=med\+&.*alpha=over:%23102030/);
});

test("methods, presets and conversions are there, and refusals say what is wrong", async () => {
  assert.ok((await client.methods()).methods.some(({ name }) => name === "mgprfs"));
  assert.ok((await client.presets()).presets.some(({ name }) => name === "print"));
  const { bytes } = await client.mesh(picture, size);
  assert.match(text(await client.convert(bytes, { format: "svg" })), /^<svg/);
  await assert.rejects(client.mesh(picture, { density: 101 }), ({ status, slug, message }) => {
    assert.match(message, /must lie in/);
    return status === 422 && slug === "parameter-out-of-range";
  });
  const silent = new Client({ url: "http://127.0.0.1:9" });
  await assert.rejects(silent.methods(), (error) => error.isPassing && error.status === 0);
  const gone = AbortSignal.abort();
  await assert.rejects(client.mesh(picture, size, { signal: gone }), { name: "AbortError" });
});
