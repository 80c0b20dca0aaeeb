// Decodes tiles of quantized-mesh by a decoder of others: one line of JSON for each path given.
import { readFile } from "node:fs/promises";
import decode from "@here/quantized-mesh-decoder";

for (const path of process.argv.slice(2)) {
  const file = await readFile(path);
  const tile = decode.default(file.buffer.slice(file.byteOffset, file.byteOffset + file.length));
  const { header, extensions, ...arrays } = tile;
  const plain = Object.entries(arrays).map(([name, array]) => [name, [...array]]);
  const normals = [...extensions.vertexNormals];
  const names = Object.keys(extensions);
  console.log(JSON.stringify({ header, ...Object.fromEntries(plain), normals, names }));
}
