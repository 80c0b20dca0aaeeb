// What takes longer than a frame: triangulations, figures and maps, beside the page.

import { densityOf } from "./density.js";
import { geometryOf } from "./geometry.js";
import { withTwins } from "./model.js";
import { prefix } from "./pmesh.js";
import { psnrDb, rasterize } from "./rasterize.js";
import { triangulate } from "./triangulate.js";

/** @typedef {import("./pmesh.js").Points} Points */
/** @typedef {import("./rasterize.js").Picture} Picture */
/**
 * What the page asks for.
 * @typedef {{ kind: "picture", picture: Picture } | { kind: "points", points: Points }
 *   | { kind: "show", size: number } | { kind: "curve", sizes: number[] }
 *   | { kind: "density" }} Order
 */
/**
 * What it hears. A generation counts the sets of points.
 * @typedef {{ kind: "mesh", generation: number, size: number, geometry: import("./geometry.js").Geometry }
 *   | { kind: "figures", generation: number, size: number, psnr: number }
 *   | { kind: "curve", generation: number, size: number, psnr: number }
 *   | { kind: "density", map: Uint8Array }} News
 */

/** @type {Picture | null} */
let picture = null;
/** @type {Points | null} */
let points = null;
let generation = 0;
/** The size to show next, 0 for none. */
let wanted = 0;
/** The size whose figures are wanted, 0 for none. */
let unmeasured = 0;
/** @type {number[]} */
let curve = [];
let isBusy = false;
/** The triangulation shown last, which figures are made from. @type {{ size: number, points: Points, origins: Uint32Array } | null} */
let shown = null;

const channel = new MessageChannel();
channel.port1.onmessage = step;

addEventListener("message", ({ data }) => {
  const order = /** @type {Order} */ (data);
  switch (order.kind) {
    case "picture":
      picture = order.picture;
      break;
    case "points":
      points = order.points;
      generation++;
      [wanted, unmeasured, curve, shown] = [0, 0, [], null];
      break;
    case "show":
      wanted = order.size;
      unmeasured = order.size;
      break;
    case "curve":
      curve = order.sizes;
      break;
    case "density":
      if (picture) tell({ kind: "density", map: densityMap(picture) });
  }
  proceed();
});

function proceed() {
  if (isBusy || !(wanted || (picture && (unmeasured || curve.length)))) return;
  isBusy = true;
  channel.port2.postMessage(null);
}

/** One piece of work, the most urgent: between two of them, orders are heard. */
function step() {
  isBusy = false;
  if (!points) return;
  if (wanted) {
    const size = wanted;
    wanted = 0;
    const { geometry, ...mesh } = meshOf(points, size);
    shown = mesh;
    const buffers = [geometry.positions, geometry.values, geometry.triangles, geometry.edges];
    tell({ kind: "mesh", generation, size, geometry }, buffers.map((array) => array.buffer));
  } else if (unmeasured && picture && shown) {
    unmeasured = 0;
    const psnr = psnrDb(picture, rasterize(shown.points, shown.origins));
    tell({ kind: "figures", generation, size: shown.size, psnr });
  } else if (curve.length && picture) {
    const size = /** @type {number} */ (curve.shift());
    const part = prefix(points, size);
    const psnr = psnrDb(picture, rasterize(part, part.faces ?? triangulate(part.xs, part.ys).origins));
    tell({ kind: "curve", generation, size, psnr });
  }
  proceed();
}

/** @param {Points} all @param {number} size */
function meshOf(all, size) {
  const part = prefix(all, size);
  const triangulation = part.faces ? withTwins(part.faces) : triangulate(part.xs, part.ys);
  return { size, points: part, origins: triangulation.origins, geometry: geometryOf(part, triangulation) };
}

/** The density as bytes, its square root, so that what is weak is seen. @param {Picture} of */
function densityMap(of) {
  return Uint8Array.from(densityOf(of), (density) => Math.round(255 * Math.sqrt(density)));
}

/** @param {News} news @param {Transferable[]} [transferred] */
function tell(news, transferred = []) {
  postMessage(news, { transfer: transferred });
}
