// What takes longer than a frame: triangulations and the density, beside the page.

import { densityOf } from "./density.js";
import { geometryOf } from "./geometry.js";
import { withTwins } from "./model.js";
import { prefix } from "./pmesh.js";
import { triangulate } from "./triangulate.js";

/** @typedef {import("./pmesh.js").Points} Points */
/** @typedef {import("./picture.js").Picture} Picture */
/**
 * What the page asks for.
 * @typedef {{ kind: "points", points: Points } | { kind: "show", size: number }
 *   | { kind: "density", picture: Picture }} Order
 */
/**
 * What it hears. A generation counts the sets of points.
 * @typedef {{ kind: "mesh", generation: number, size: number, geometry: import("./geometry.js").Geometry }
 *   | { kind: "density", map: Uint8Array }} News
 */

/** @type {Points | null} */
let points = null;
let generation = 0;
/** The size to show next, 0 for none. */
let wanted = 0;

const channel = new MessageChannel();
channel.port1.onmessage = showWanted;

addEventListener("message", ({ data }) => {
  const order = /** @type {Order} */ (data);
  if (order.kind === "points") {
    points = order.points;
    generation++;
    wanted = 0;
  } else if (order.kind === "show") {
    // Of several sizes that were asked for meanwhile, only the last is of use.
    if (!wanted) channel.port2.postMessage(null);
    wanted = order.size;
  } else {
    tell({ kind: "density", map: densityMap(order.picture) });
  }
});

function showWanted() {
  if (!points || !wanted) return;
  const size = wanted;
  wanted = 0;
  const part = prefix(points, size);
  const triangulation = part.faces ? withTwins(part.faces) : triangulate(part.xs, part.ys);
  const geometry = geometryOf(part, triangulation);
  const { positions, values, triangles, edges } = geometry;
  tell({ kind: "mesh", generation, size, geometry }, [positions, values, triangles, edges].map((array) => array.buffer));
}

/** The density as bytes, its square root, so that what is weak is seen. @param {Picture} of */
function densityMap(of) {
  return Uint8Array.from(densityOf(of), (density) => Math.round(255 * Math.sqrt(density)));
}

/** @param {News} news @param {Transferable[]} [transferred] */
function tell(news, transferred = []) {
  postMessage(news, { transfer: transferred });
}
