// What people want to make: the presets of the service, with what the page adds to them.

import { OF_OUTPUT } from "./methods.js";
import { SOLID } from "./relief.js";

/** @typedef {import("./api.js").Parameters} Parameters */
/** @typedef {import("./looks.js").Look} Look */
/**
 * @typedef {object} Preset
 * @property {string} title
 * @property {string} about
 * @property {Parameters} parameters  Of the mesh.
 * @property {Partial<Look>} look
 * @property {Partial<import("./relief.js").Solid> | null} solid  In three dimensions.
 * @property {boolean} isTextured  Whether files in three dimensions show the picture itself.
 * @property {string} format  What is taken away first.
 */

/** Another look of one of the service's presets. */
const GLASS = { title: "Stained glass", about: "Facets with dark leading between them, as SVG.", look: { edges: 2.5, edgeColor: "#14110f" } };
/** The height of hills in percent of the longer side, for pictures whose scale nobody knows. */
const HILLS_PERCENT = 12;

/** By their names. @param {import("./api.js").PresetRow[]} rows @returns {Map<string, Preset>} */
export function presetsOf(rows) {
  return new Map(rows.flatMap(({ name, title, about, format, parameters }) => {
    const all = Object.entries(parameters).map(([name, value]) => [name, String(value)]);
    /** @type {Parameters} */
    const written = Object.fromEntries(all.filter(([name]) => OF_OUTPUT.has(name)));
    /** @type {Preset} */
    const preset = {
      title, about, format: format ?? "svg", look: {}, solid: solidOf(written), isTextured: written.texture === "embed",
      parameters: Object.fromEntries(all.filter(([name]) => !OF_OUTPUT.has(name))),
    };
    return name === "lowpoly" ? [[name, preset], ["glass", { ...preset, ...GLASS }]] : [[name, preset]];
  }));
}

/** What is seen in three dimensions of parameters of the service; null where they have no height. @param {Parameters} written */
function solidOf({ relief, color, invert_relief, width, height, base }) {
  if (!relief) return null;
  const percent = width && height ? (100 * Number(height)) / Number(width) : HILLS_PERCENT;
  return {
    percent, invert: invert_relief === "true", width: Number(width ?? SOLID.width), base: Number(base ?? SOLID.base),
    color: /** @type {import("./relief.js").Solid["color"]} */ (color ?? "none"),
  };
}

/** The most vertices of a preset for a picture, which may have fewer pixels than that. @param {number} pixels */
export function mostVertices(pixels) {
  return Math.max(4, Math.floor(pixels / 4));
}

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
