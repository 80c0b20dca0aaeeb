// Decompresses the views of glTF files by the decoder of the library that defines them: one line of
// JSON for each path given, with the document and the bytes of every view in base64.
import { readFile } from "node:fs/promises";
import { MeshoptDecoder } from "meshoptimizer";

await MeshoptDecoder.ready;
for (const path of process.argv.slice(2)) {
  const file = await readFile(path);
  const jsonLength = file.readUInt32LE(12);
  const document = JSON.parse(file.subarray(20, 20 + jsonLength).toString());
  const buffer = file.subarray(28 + jsonLength);
  const views = document.bufferViews.map((view) => {
    const packed = view.extensions?.EXT_meshopt_compression;
    if (!packed) {
      return buffer.subarray(view.byteOffset, view.byteOffset + view.byteLength);
    }
    const source = buffer.subarray(packed.byteOffset, packed.byteOffset + packed.byteLength);
    const target = new Uint8Array(packed.count * packed.byteStride);
    MeshoptDecoder.decodeGltfBuffer(target, packed.count, packed.byteStride, source, packed.mode);
    return Buffer.from(target);
  });
  console.log(JSON.stringify({ document, views: views.map((view) => view.toString("base64")) }));
}
