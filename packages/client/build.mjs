// Makes dist/ of the modules here, those of the studio that read meshes, and the OpenAPI document.

import { cp, mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { execFileSync } from "node:child_process";
import { build } from "esbuild";
import openapi, { astToString } from "openapi-typescript";

const at = (path) => new URL(path, import.meta.url);
const OF_STUDIO = ["compact", "model", "pmesh", "predicates", "triangulate"];
const SCHEMAS = ["Job", "JobEvent", "Methods", "Presets", "Problem"];

/** The schemas named and those that they refer to. */
function needed(all, names, found = {}) {
  for (const name of names) {
    if (name in found) continue;
    found[name] = all[name];
    const referred = JSON.stringify(all[name]).matchAll(/#\/components\/schemas\/(\w+)/g);
    needed(all, [...referred].map(([, other]) => other), found);
  }
  return found;
}

/** The types of what the client sends and gets. */
async function types() {
  const document = JSON.parse(await readFile(at("../../openapi/openapi.json"), "utf8"));
  const schemas = needed(document.components.schemas, SCHEMAS);
  const parameters = document.paths["/v1/meshes"].post.parameters.filter((parameter) => parameter.in === "query");
  const properties = parameters.map(({ name, description, schema }) => [name, { ...schema, description }]);
  schemas.MeshParameters = { type: "object", properties: Object.fromEntries(properties) };
  const reduced = { openapi: "3.1.0", info: document.info, paths: {}, components: { schemas } };
  return astToString(await openapi(reduced));
}

await rm(at("build"), { recursive: true, force: true });
await rm(at("dist"), { recursive: true, force: true });
await mkdir(at("build"));
await cp(at("src"), at("build"), { recursive: true });
for (const name of OF_STUDIO) await cp(at(`../../studio/page/${name}.js`), at(`build/${name}.js`));
await writeFile(at("build/schema.d.ts"), await types());
await mkdir(at("dist"));
await cp(at("build/schema.d.ts"), at("dist/schema.d.ts"));
execFileSync(at("node_modules/.bin/tsc").pathname, ["--project", at("tsconfig.json").pathname], { stdio: "inherit" });
await build({
  entryPoints: [at("build/index.js").pathname],
  outfile: at("dist/index.js").pathname,
  bundle: true,
  format: "esm",
  minify: true,
  target: "es2022",
});
