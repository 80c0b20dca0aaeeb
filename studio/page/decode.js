// Files as the browser decodes them, and what kind of pictures they are.

/** What kind of picture it is. @typedef {{ hasAlpha: boolean, isGray: boolean, isGraphic: boolean }} Nature */
/** @typedef {import("./picture.js").Bitmap} Bitmap */

/**
 * The pixels of a file, upright and without colour management, as the service reads them; null
 * where the browser does not know the format.
 * @param {Blob} file @param {number} [maxSide]  A larger picture is made smaller. @param {number} [maxPixels]
 * @returns {Promise<Bitmap | null>}
 */
export async function decoded(file, maxSide = Infinity, maxPixels = Infinity) {
  let image;
  try {
    image = await createImageBitmap(file, { colorSpaceConversion: "none", premultiplyAlpha: "none", imageOrientation: "from-image" });
  } catch {
    return null;
  }
  const { width: fullWidth, height: fullHeight } = image;
  const scale = Math.min(1, maxSide / Math.max(fullWidth, fullHeight), Math.sqrt(maxPixels / (fullWidth * fullHeight)));
  const width = Math.max(1, Math.round(fullWidth * scale)), height = Math.max(1, Math.round(fullHeight * scale));
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  if (!context) return null;
  // Rows from the bottom.
  context.setTransform(1, 0, 0, -1, 0, height);
  context.drawImage(image, 0, 0, width, height);
  image.close();
  const { data } = context.getImageData(0, 0, width, height);
  return { width, height, rgba: new Uint8Array(data.buffer), fullWidth, fullHeight };
}

/** Looks at some thousand pixels: is it transparent, gray, of few colours? @param {Bitmap} bitmap @returns {Nature} */
export function natureOf({ width, height, rgba }) {
  const step = Math.max(1, Math.floor((width * height) / 20_000));
  const colors = new Map();
  let transparent = 0, colored = 0, seen = 0, flat = 0;
  for (let i = 0; i < width * height; i += step, seen++) {
    const [r, g, b, a] = rgba.subarray(4 * i, 4 * i + 4);
    if (a < 250) transparent++;
    if (Math.max(r, g, b) - Math.min(r, g, b) > 6) colored++;
    const right = 4 * Math.min(i + 1, width * height - 1);
    if (rgba[right] === r && rgba[right + 1] === g && rgba[right + 2] === b) flat++;
    const color = (r >> 3) * 1024 + (g >> 3) * 32 + (b >> 3);
    colors.set(color, (colors.get(color) ?? 0) + 1);
  }
  const most = [...colors.values()].sort((a, b) => b - a).slice(0, 8).reduce((sum, count) => sum + count, 0);
  return { hasAlpha: transparent > seen / 200, isGray: colored < seen / 500, isGraphic: most > 0.8 * seen && flat > 0.8 * seen };
}
