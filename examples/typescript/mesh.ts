// Saves a mesh of a picture in mesh.model. The compiler checks paths, parameters, their values and
// refusals against the service's OpenAPI document.

import { readFile, rename, writeFile } from "node:fs/promises";
import createClient from "openapi-fetch";
import type { components, operations, paths } from "./schema.js";

type Parameters = NonNullable<operations["createMesh"]["parameters"]["query"]>;
type Problem = components["schemas"]["Problem"];
type Made = { model: string; vertices: number; faces: number; psnr: number };

const key = process.env["PIXMESH_KEY"];
const client = createClient<paths>({
  baseUrl: process.env["PIXMESH_URL"] ?? "http://127.0.0.1:8080",
  headers: key === undefined ? {} : { authorization: `Bearer ${key}` },
});

async function mesh(picture: Uint8Array, query: Parameters): Promise<Made | Problem> {
  const { data, error, response } = await client.POST("/v1/meshes", {
    params: { query },
    // The document calls bytes a string; they go as they are.
    body: picture as unknown as string,
    bodySerializer: (body) => body,
    headers: { "content-type": "application/octet-stream" },
    parseAs: "text",
  });
  if (error !== undefined) return error;
  const figure = (name: string) => Number(response.headers.get(name)?.replace("inf", "Infinity"));
  return {
    model: data,
    vertices: figure("mesh-vertices"),
    faces: figure("mesh-faces"),
    psnr: figure("mesh-psnr"),
  };
}

/** Submits a job and waits for its end, asking for what is known of it. */
async function job(picture: Uint8Array, query: Parameters): Promise<components["schemas"]["Job"] | Problem> {
  const submitted = await client.POST("/v1/jobs", {
    params: { query },
    body: picture as unknown as string,
    bodySerializer: (body) => body,
    headers: { "content-type": "application/octet-stream" },
  });
  if (submitted.error !== undefined) return submitted.error;
  for (let known = submitted.data; ; ) {
    if (known.state !== "queued" && known.state !== "running") return known;
    await new Promise((resolve) => setTimeout(resolve, 100));
    const { data, error } = await client.GET("/v1/jobs/{id}", { params: { path: { id: known.id } } });
    if (error !== undefined) return error;
    known = data;
  }
}

/** Writes a file; a former one of the name stays until the new one is whole. */
async function save(name: string, text: string): Promise<void> {
  await writeFile(`${name}.part`, text);
  await rename(`${name}.part`, name);
}

const [path] = process.argv.slice(2);
if (path === undefined) {
  console.error("usage: npm start -- PICTURE");
  process.exit(2);
}
const picture = await readFile(path);

const { data: offered } = await client.GET("/v1/methods");
console.log(`methods: ${offered?.methods.map((method) => method.name).join(", ")}`);

const made = await mesh(picture, { method: "mgprfs", density: 2, policy: "psd_max_d" });
if ("model" in made) {
  await save("mesh.model", made.model);
  console.log(`${made.vertices} vertices, ${made.faces} faces, ${made.psnr.toFixed(2)} dB, ${made.model.length} bytes`);
} else {
  console.error(`${made.title}: ${made.detail}`);
  process.exitCode = 1;
}

const done = await job(picture, { method: "med", density: 1 });
if ("state" in done) console.log(`job: ${done.state}, ${done.mesh?.vertices} vertices`);

const refused = await mesh(picture, { density: 2, size: 1000 });
if ("type" in refused) console.log(`refused: ${refused.type}, ${refused.param}`);
