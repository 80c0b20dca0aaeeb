// What people want to make. Until the service lists its presets, their parameters stand here.

/** @typedef {import("./looks.js").Look} Look */
/**
 * @typedef {object} Preset
 * @property {string} title
 * @property {string} about
 * @property {import("./api.js").Parameters} parameters  Of the mesh.
 * @property {Partial<Look>} look
 * @property {Partial<import("./relief.js").Solid> | null} solid  In three dimensions.
 * @property {string} format  What is taken away first.
 */

/** By the service's names; `glass` is a look of `lowpoly`. @type {Record<string, Preset>} */
export const PRESETS = {
  photo: {
    title: "Photo", about: "Close to the picture, small and fast.",
    parameters: { method: "mgprfs", density: "2" }, look: {}, solid: null, format: "svg",
  },
  lowpoly: {
    title: "Low-poly", about: "Flat facets, as in illustrations.",
    parameters: { method: "flat", size: "600" }, look: {}, solid: null, format: "svg",
  },
  glass: {
    title: "Stained glass", about: "Facets with dark leading.",
    parameters: { method: "flat", size: "350" }, look: { edges: 2.5, edgeColor: "#14110f" }, solid: null, format: "svg",
  },
  sprite: {
    title: "Game sprite", about: "Cut out along its alpha.",
    parameters: { method: "mgprfs", density: "3", initial: "insertion", alpha: "cut" }, look: {}, solid: null, format: "glb",
  },
  logo: {
    title: "Logo", about: "Sharp edges and even areas.",
    parameters: { method: "mgprfs", density: "2", initial: "insertion" }, look: {}, solid: null, format: "svg",
  },
  terrain: {
    title: "Terrain", about: "Bright is high, with shaded slopes.",
    parameters: { method: "mgprfs", density: "2" }, look: {}, solid: { color: "hillshade", percent: 12 }, format: "glb",
  },
  print: {
    title: "Lithophane", about: "A plate to print and hold to the light.",
    parameters: { method: "mgprfs", density: "5" }, look: {}, solid: { color: "none", invert: true, percent: 3, width: 100, base: 0.8 }, format: "stl",
  },
  placeholder: {
    title: "Placeholder", about: "A few hundred bytes until a picture loads.",
    parameters: { method: "mgprfs", size: "60" }, look: {}, solid: null, format: "svg",
  },
  draft: {
    title: "Draft", about: "In a moment, less accurate.",
    parameters: { method: "med", density: "2" }, look: {}, solid: null, format: "svg",
  },
};

/** What suits a picture. @param {import("./decode.js").Nature | null} nature */
export function suited(nature) {
  if (!nature) return "photo";
  if (nature.hasAlpha) return "sprite";
  return nature.isGraphic ? "logo" : "photo";
}

/** How close a mesh is, in a word; the figure stands beside it. @param {number | null | undefined} psnr */
export function likeness(psnr) {
  if (psnr === undefined || psnr === null) return psnr === null ? "Identical" : "–";
  if (!Number.isFinite(psnr)) return "Identical";
  const words = /** @type {[number, string][]} */ ([[45, "Looks identical"], [38, "Hard to tell apart"], [32, "Very close"], [27, "Close"], [22, "Stylised"]]);
  return words.find(([least]) => psnr >= least)?.[1] ?? "Abstract";
}
