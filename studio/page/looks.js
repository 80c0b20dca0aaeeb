// Looks: other colours, edges and a background for a mesh. Where it is not said otherwise, what is
// drawn on the page and what is written into files go through the same functions.

/**
 * @typedef {object} Look
 * @property {"smooth" | "flat"} shading
 * @property {number} edges  Width in pixels of the picture, 0 for none.
 * @property {string} edgeColor
 * @property {"original" | "palette" | "duotone"} colors
 * @property {number} count  Colours of the palette, 2 to 16.
 * @property {string} dark  Of a duotone.
 * @property {string} light
 * @property {string} background  Behind transparent places; empty for none.
 */

/** @type {Readonly<Look>} */
export const PLAIN = Object.freeze({
  shading: "smooth", edges: 0, edgeColor: "#14110f", colors: "original", count: 8, dark: "#2b1055", light: "#ffd194", background: "",
});

/** Whether the service's own files show a look. @param {Look} look */
export function isPlain({ edges, colors, background }) {
  return edges === 0 && colors === "original" && background === "";
}

/** A look in an address, as what differs from the plain one. @param {Look} look */
export function textOf(look) {
  const names = /** @type {(keyof Look)[]} */ (Object.keys(PLAIN));
  return names.filter((name) => look[name] !== PLAIN[name]).map((name) => `${name}:${look[name]}`).join("~");
}

/** The look of an address; what is not known or not valid is left out. @param {string} text @returns {Look} */
export function lookOf(text) {
  const look = { ...PLAIN };
  for (const pair of text.split("~")) {
    const [name, value = ""] = pair.split(":");
    const isColor = /^#[0-9a-f]{6}$/.test(value);
    if (name === "shading" && (value === "flat" || value === "smooth")) look.shading = value;
    if (name === "colors" && (value === "palette" || value === "duotone")) look.colors = value;
    if (name === "edges") look.edges = Math.min(12, Math.max(0, Number(value) || 0));
    if (name === "count") look.count = Math.min(16, Math.max(2, Math.round(Number(value)) || 8));
    if ((name === "edgeColor" || name === "dark" || name === "light" || name === "background") && isColor) look[name] = value;
  }
  return look;
}

/** @param {string} color @returns {[number, number, number]} */
export function channels(color) {
  return /** @type {[number, number, number]} */ ([1, 3, 5].map((at) => Number.parseInt(color.slice(at, at + 2), 16)));
}

/** @param {number} value */
const two = (value) => Math.round(value).toString(16).padStart(2, "0");

/** @param {ArrayLike<number>} rgb  Levels of 0 to 255. */
export function hex(rgb) {
  return `#${two(rgb[0])}${two(rgb[1])}${two(rgb[2])}`;
}

/**
 * The colour that a look has for one, levels of 0 to 255.
 * @param {Look} look @param {Uint8Array} palette  Three bytes a colour.
 * @returns {(rgb: [number, number, number]) => [number, number, number]}
 */
export function mapping({ colors, dark, light }, palette) {
  if (colors === "duotone") {
    const [low, high] = [channels(dark), channels(light)];
    return ([r, g, b]) => {
      const luma = (0.299 * r + 0.587 * g + 0.114 * b) / 255;
      return [low[0] + (high[0] - low[0]) * luma, low[1] + (high[1] - low[1]) * luma, low[2] + (high[2] - low[2]) * luma];
    };
  }
  if (colors === "palette" && palette.length) return (rgb) => nearest(rgb, palette);
  return (rgb) => rgb;
}

/** @param {[number, number, number]} rgb @param {Uint8Array} palette @returns {[number, number, number]} */
function nearest(rgb, palette) {
  let best = 0, least = Infinity;
  for (let at = 0; at < palette.length; at += 3) {
    const distance = (palette[at] - rgb[0]) ** 2 + (palette[at + 1] - rgb[1]) ** 2 + (palette[at + 2] - rgb[2]) ** 2;
    if (distance < least) [best, least] = [at, distance];
  }
  return [palette[best], palette[best + 1], palette[best + 2]];
}

/**
 * A palette of some colours by the median cut: the box of the largest spread is halved again and
 * again. P. Heckbert, "Color image quantization for frame buffer display", 1982.
 * @param {Uint8Array} colors  Three bytes a colour. @param {number} count
 */
export function paletteOf(colors, count) {
  /** @type {number[][]} */
  let boxes = [Array.from({ length: colors.length / 3 }, (_, i) => 3 * i)];
  /** @param {number[]} box */
  const spread = (box) => {
    const widths = [0, 1, 2].map((k) => {
      let low = 255, high = 0;
      for (const at of box) [low, high] = [Math.min(low, colors[at + k]), Math.max(high, colors[at + k])];
      return high - low;
    });
    const channel = widths.indexOf(Math.max(...widths));
    return { channel, width: widths[channel] };
  };
  while (boxes.length < count) {
    const spreads = boxes.map(spread);
    const widest = spreads.reduce((best, { width }, i) => (width > spreads[best].width ? i : best), 0);
    const { channel, width } = spreads[widest];
    if (width === 0) break;
    const box = boxes[widest].sort((a, b) => colors[a + channel] - colors[b + channel] || a - b);
    const half = box.length >> 1;
    boxes = [...boxes.slice(0, widest), box.slice(0, half), box.slice(half), ...boxes.slice(widest + 1)];
  }
  return Uint8Array.from(boxes.filter((box) => box.length).flatMap((box) => {
    return [0, 1, 2].map((k) => Math.round(box.reduce((sum, at) => sum + colors[at + k], 0) / box.length));
  }));
}

/**
 * Gives vertices the colours of a look, and returns the palette of it.
 * @param {Uint16Array} values  Four for each vertex, premultiplied. @param {Look} look
 */
export function recolor(values, look) {
  if (look.colors === "original") return new Uint8Array();
  const count = values.length / 4;
  const straight = new Uint8Array(3 * count);
  for (let v = 0; v < count; v++) {
    const alpha = values[4 * v + 3] || 1;
    for (let k = 0; k < 3; k++) straight[3 * v + k] = Math.min(255, Math.round((255 * values[4 * v + k]) / alpha));
  }
  const palette = look.colors === "palette" ? paletteOf(straight, look.count) : new Uint8Array();
  const map = mapping(look, palette);
  for (let v = 0; v < count; v++) {
    const mapped = map([straight[3 * v], straight[3 * v + 1], straight[3 * v + 2]]);
    for (let k = 0; k < 3; k++) values[4 * v + k] = Math.round((mapped[k] / 255) * values[4 * v + 3]);
  }
  return palette;
}
