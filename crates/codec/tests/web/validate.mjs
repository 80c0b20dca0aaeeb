// Validates glTF files with the Khronos validator: one line of JSON for each path given, with the
// path, the numbers of errors and warnings, and the messages.
import { readFile } from "node:fs/promises";
import validator from "gltf-validator";

for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(await readFile(path)));
  const { numErrors: errors, numWarnings: warnings, messages } = report.issues;
  console.log(JSON.stringify({ path, errors, warnings, messages }));
}
