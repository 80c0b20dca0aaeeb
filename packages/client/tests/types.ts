// What the compiler must accept, and must refuse, of the installed package.

import { BufferAttribute, BufferGeometry } from "three";
import { Client, type Parameters, buffersOf, readPmesh } from "pixmesh-client";

const client = new Client({ url: "http://localhost:8080", key: "key" });
const parameters: Parameters = { preset: "lowpoly", size: 300, format: "pmesh" };

export async function geometry(picture: Blob, signal: AbortSignal): Promise<BufferGeometry> {
  const { bytes, psnr } = await client.mesh(picture, parameters, { signal });
  const { positions, colors, uvs, indices } = buffersOf(await readPmesh(bytes));
  const made = new BufferGeometry();
  made.setAttribute("position", new BufferAttribute(positions, 3));
  made.setAttribute("color", new BufferAttribute(colors, 4, true));
  made.setAttribute("uv", new BufferAttribute(uvs, 2));
  made.setIndex(new BufferAttribute(indices, 1));
  made.userData.psnr = psnr;
  return made;
}

// @ts-expect-error there is no such preset
export const misspelt: Parameters = { preset: "lowpolly" };
// @ts-expect-error a size is a number
export const text: Parameters = { size: "many" };
