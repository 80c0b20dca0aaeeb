// Meshes of pixmesh in JavaScript: files to points, points to faces, both to buffers; and the service.

export { buffersOf, facesOf } from "./buffers.js";
export { Client, ServiceError } from "./client.js";
export { readModel } from "./model.js";
export { prefix, psnrOf, readPmesh } from "./pmesh.js";

/** @typedef {import("./pmesh.js").Points} Points */
/** @typedef {import("./buffers.js").Buffers} Buffers */
/** @typedef {import("./schema.js").components["schemas"]} Schemas */
/** @typedef {Schemas["MeshParameters"]} Parameters */
/** @typedef {Schemas["Job"]} Job */
/** @typedef {Schemas["JobEvent"]} JobEvent */
/** @typedef {Schemas["Methods"]} Methods */
/** @typedef {Schemas["Presets"]} Presets */
/** @typedef {Schemas["Problem"]} Problem */
/** @typedef {import("./client.js").Answer} Answer */
