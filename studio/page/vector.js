// SVG that the page writes itself: meshes of a look, and meshes that grow.

import { channels, hex, isPlain, mapping } from "./looks.js";

/** @typedef {import("./geometry.js").Geometry} Geometry */
/** @typedef {import("./looks.js").Look} Look */
/** @typedef {{ width: number, height: number }} Size */

/** Pixels by which faces overlap, so that no seam is seen between them. */
const OVERLAP = 0.6;

/** Whether the page writes the SVG of a look itself, by its flat faces. @param {Look} look @param {boolean} isFlat */
export function isOwn(look, isFlat) {
  return isFlat && !isPlain(look);
}

/** @param {Size} size @param {string} [style] */
function head({ width, height }, style = "") {
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}">${style}`;
}

/** A place in the coordinates of SVG, those of the border on it. @param {Geometry} geometry @param {number} v @param {Size} size */
function place({ positions }, v, { width, height }) {
  const x = positions[2 * v], y = positions[2 * v + 1];
  const across = x <= 0 ? 0 : x >= width - 1 ? width : x + 0.5;
  const down = y <= 0 ? height : y >= height - 1 ? 0 : height - y - 0.5;
  return `${across} ${down}`;
}

/** The flat faces, those of one colour in one path. @param {Geometry} geometry @param {Size} size @param {number} most */
function faces(geometry, size, most) {
  /** @type {Map<string, string[]>} */
  const paths = new Map();
  const { triangles, values, faceCount } = geometry;
  for (let f = 0; f < faceCount; f++) {
    const [a, b, c] = triangles.subarray(3 * f, 3 * f + 3);
    const sum = [0, 0, 0, 0];
    for (const v of [a, b, c]) for (let k = 0; k < 4; k++) sum[k] += values[4 * v + k];
    if (sum[3] === 0) continue;
    const rgb = [0, 1, 2].map((k) => Math.min(255, (255 * sum[k]) / sum[3]));
    const alpha = Math.round((100 * sum[3]) / (3 * most)) / 100;
    const fill = alpha < 1 ? `${hex(rgb)}" opacity="${alpha}` : hex(rgb);
    const path = `M${place(geometry, a, size)}L${place(geometry, b, size)}L${place(geometry, c, size)}Z`;
    const known = paths.get(fill);
    if (known) known.push(path);
    else paths.set(fill, [path]);
  }
  return [...paths].map(([fill, parts]) => `<path fill="${fill}" stroke="${fill.slice(0, 7)}" d="${parts.join("")}"/>`).join("");
}

/** @param {Geometry} geometry @param {Size} size @param {Look} look */
function edges(geometry, size, { edges: width, edgeColor }) {
  if (width === 0) return "";
  const parts = [];
  for (let i = 0; i < geometry.edges.length; i += 2) {
    parts.push(`M${place(geometry, geometry.edges[i], size)}L${place(geometry, geometry.edges[i + 1], size)}`);
  }
  return `<path fill="none" stroke="${edgeColor}" stroke-width="${width}" stroke-linecap="round" d="${parts.join("")}"/>`;
}

/** @param {Size} size @param {Look} look */
function ground({ width, height }, { background }) {
  return background ? `<rect width="${width}" height="${height}" fill="${background}"/>` : "";
}

/** A mesh of flat faces in its look. @param {Geometry} geometry @param {Size} size @param {number} most @param {Look} look */
export function flatSvg(geometry, size, most, look) {
  const inner = `<g stroke-width="${OVERLAP}" stroke-linejoin="round">${faces(geometry, size, most)}</g>`;
  return `${head(size)}${ground(size, look)}${inner}${edges(geometry, size, look)}</svg>\n`;
}

/**
 * The service's SVG of gradients in a look: its colours mapped, which linear maps do exactly.
 * @param {string} svg @param {Geometry} geometry @param {Size} size @param {Look} look
 */
export function restyled(svg, geometry, size, look) {
  const map = mapping(look, new Uint8Array());
  const colored = look.colors === "duotone" ? svg.replaceAll(/#[0-9a-f]{6}\b/gi, (color) => hex(map(channels(color.toLowerCase())))) : svg;
  const begin = colored.indexOf(">", colored.indexOf("<svg")) + 1;
  const end = colored.lastIndexOf("</svg>");
  return `${colored.slice(0, begin)}${ground(size, look)}${colored.slice(begin, end)}${edges(geometry, size, look)}${colored.slice(end)}`;
}

/**
 * A mesh that grows: its sizes one after another, the last one longer, for ever.
 * @param {Geometry[]} stills @param {Size} size @param {number} most @param {Look} look @param {number} seconds
 */
export function growingSvg(stills, size, most, look, seconds) {
  const count = stills.length, last = 0.3;
  const share = (100 * (1 - last)) / Math.max(1, count - 1);
  const frames = stills.map((geometry, i) => {
    return `<g class="f f${i}">${faces(geometry, size, most)}${edges(geometry, size, look)}</g>`;
  });
  const rules = stills.map((_, i) => {
    const from = (i * share).toFixed(2), to = i + 1 < count ? ((i + 1) * share).toFixed(2) : "100";
    const before = i > 0 ? `0%{visibility:hidden}${from}%{visibility:visible}` : "0%{visibility:visible}";
    const after = i + 1 < count ? `${to}%{visibility:hidden}100%{visibility:hidden}` : "100%{visibility:visible}";
    return `@keyframes k${i}{${before}${after}}.f${i}{animation-name:k${i}}`;
  });
  const shared = `.f{visibility:hidden;stroke-width:${OVERLAP};stroke-linejoin:round;animation:${seconds}s step-end infinite}`;
  // Where nothing may move, the whole mesh is seen.
  const still = `@media(prefers-reduced-motion:reduce){.f{animation:none}.f${count - 1}{visibility:visible}}`;
  return `${head(size, `<style>${shared}${rules.join("")}${still}</style>`)}${ground(size, look)}${frames.join("")}</svg>\n`;
}
