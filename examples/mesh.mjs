// A mesh of a picture with fetch, in a browser and in Node.js.

const ATTEMPTS = 5;

/** A problem document (RFC 9457), in `problem`. */
export class Refused extends Error {
  constructor(problem) {
    super(`${problem.title}: ${problem.detail}`);
    this.problem = problem;
  }
}

/**
 * The mesh of a picture (a Blob, File or bytes) in the format asked for, and the mesh's figures.
 *
 * Where the service is busy it is asked again after as long as it says, until `signal` is raised.
 */
export async function mesh(url, picture, parameters = {}, { key, signal } = {}) {
  const headers = { "content-type": "application/octet-stream" };
  if (key) headers.authorization = `Bearer ${key}`;
  const target = `${url}/v1/meshes?${new URLSearchParams(parameters)}`;
  for (let attempt = 1; ; attempt += 1) {
    const answer = await fetch(target, { method: "POST", headers, body: picture, signal });
    if (answer.ok) return { bytes: await answer.arrayBuffer(), ...figures(answer.headers) };
    const problem = await answer.json();
    const waitSeconds = answer.headers.get("retry-after");
    if (waitSeconds === null || attempt === ATTEMPTS) throw new Refused(problem);
    await new Promise((resolve) => setTimeout(resolve, 1000 * Number(waitSeconds)));
  }
}

function figures(headers) {
  return {
    vertices: Number(headers.get("mesh-vertices")),
    faces: Number(headers.get("mesh-faces")),
    psnr: Number(headers.get("mesh-psnr").replace("inf", "Infinity")),
  };
}

/** Writes a file in Node.js; a former one of the name stays until the new one is whole. */
export async function save(name, bytes) {
  const { rename, writeFile } = await import("node:fs/promises");
  await writeFile(`${name}.part`, new Uint8Array(bytes));
  await rename(`${name}.part`, name);
}

/** Saves a mesh in mesh.model, or in a file of the format asked for. */
async function main(path, ...pairs) {
  if (path === undefined) {
    console.error("usage: node examples/mesh.mjs PICTURE [NAME=VALUE ...]");
    process.exit(2);
  }
  const { readFile } = await import("node:fs/promises");
  const url = process.env.PIXMESH_URL ?? "http://127.0.0.1:8080";
  const parameters = pairs.length > 0 ? Object.fromEntries(pairs.map((pair) => pair.split("="))) : { density: 2 };
  try {
    const made = await mesh(url, await readFile(path), parameters, { key: process.env.PIXMESH_KEY });
    await save(`mesh.${parameters.format ?? "model"}`, made.bytes);
    console.log(
      `${made.vertices} vertices, ${made.faces} faces, ${made.psnr.toFixed(2)} dB, ${made.bytes.byteLength} bytes`,
    );
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    console.error(JSON.stringify(error.problem));
    process.exitCode = 1;
  }
}

if (typeof process !== "undefined" && import.meta.filename === process.argv[1]) {
  await main(...process.argv.slice(2));
}
