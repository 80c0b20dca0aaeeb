// What takes longer than a frame: triangulations and the density, beside the page.

import { densityOf } from "./density.js";
import { geometryOf } from "./geometry.js";
import { PLAIN, recolor } from "./looks.js";
import { withTwins } from "./model.js";
import { prefix } from "./pmesh.js";
import { triangulate } from "./triangulate.js";

/** @typedef {import("./pmesh.js").Points} Points */
/** @typedef {import("./picture.js").Picture} Picture */
/** @typedef {import("./looks.js").Look} Look */
/**
 * What the page asks for.
 * @typedef {{ kind: "points", points: Points | null, generation: number } | { kind: "show", size: number }
 *   | { kind: "still", size: number } | { kind: "look", look: Look } | { kind: "density", picture: Picture }} Order
 */
/**
 * What it hears. A generation counts the sets of points.
 * @typedef {{ kind: "mesh", generation: number, size: number, geometry: import("./geometry.js").Geometry }
 *   | { kind: "still", size: number, geometry: import("./geometry.js").Geometry }
 *   | { kind: "density", map: Uint8Array }} News
 */

/** @type {Points | null} */
let points = null;
let generation = 0;
/** @type {Look} */
let look = PLAIN;
/** The size to show next, 0 for none; and the one shown last. */
let wanted = 0, shown = 0;

const channel = new MessageChannel();
channel.port1.onmessage = showWanted;

addEventListener("message", ({ data }) => {
  const order = /** @type {Order} */ (data);
  if (order.kind === "points") {
    ({ points, generation } = order);
    wanted = shown = 0;
  } else if (order.kind === "show") {
    show(order.size);
  } else if (order.kind === "look") {
    look = order.look;
    if (shown) show(wanted || shown);
  } else if (order.kind === "still" && points) {
    const geometry = madeOf(points, order.size);
    tell({ kind: "still", size: order.size, geometry }, buffersOf(geometry));
  } else if (order.kind === "density") {
    tell({ kind: "density", map: densityMap(order.picture) });
  }
});

/** Of several sizes that were asked for meanwhile, only the last is of use. @param {number} size */
function show(size) {
  if (!wanted) channel.port2.postMessage(null);
  wanted = size;
}

function showWanted() {
  if (!points || !wanted) return;
  const size = wanted;
  [wanted, shown] = [0, size];
  const geometry = madeOf(points, size);
  tell({ kind: "mesh", generation, size, geometry }, buffersOf(geometry));
}

/** @param {Points} of @param {number} size */
function madeOf(of, size) {
  const part = prefix(of, size);
  const triangulation = part.faces ? withTwins(part.faces) : triangulate(part.xs, part.ys);
  const geometry = geometryOf(part, triangulation, look.shading === "flat");
  recolor(geometry.values, look);
  return geometry;
}

/** @param {import("./geometry.js").Geometry} geometry */
function buffersOf({ positions, values, triangles, edges }) {
  return [positions, values, triangles, edges].map((array) => array.buffer);
}

/** The density as bytes, its square root, so that what is weak is seen. @param {Picture} of */
function densityMap(of) {
  return Uint8Array.from(densityOf(of), (density) => Math.round(255 * Math.sqrt(density)));
}

/** @param {News} news @param {Transferable[]} [transferred] */
function tell(news, transferred = []) {
  postMessage(news, { transfer: transferred });
}
