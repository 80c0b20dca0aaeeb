// The picture that a mesh models, and how far it is from the original: exactly as the service
// computes both.

/** @typedef {import("./pmesh.js").Points} Points */

/**
 * A picture of samples, pixel by pixel, rows from the bottom.
 * @typedef {object} Picture
 * @property {number} width
 * @property {number} height
 * @property {number} components
 * @property {number} precision
 * @property {Uint8Array | Uint16Array} samples
 */

/**
 * In each triangle each component is the linear interpolant of the vertices' samples, rounded to
 * the nearest integer, halves up. Neighbours agree on their common edge, so both may write it.
 * @param {Points} points @param {Uint32Array} origins
 * @returns {Picture}
 */
export function rasterize(points, origins) {
  const { width, height, components, precision } = points;
  const length = width * height * components;
  const samples = precision <= 8 ? new Uint8Array(length) : new Uint16Array(length);
  const picture = { width, height, components, precision, samples };
  for (let h = 0; h < origins.length; h += 3) {
    fillTriangle(picture, points, origins[h], origins[h + 1], origins[h + 2]);
  }
  return picture;
}

/**
 * @param {Picture} picture @param {Points} points
 * @param {number} a @param {number} b @param {number} c
 */
function fillTriangle(picture, { xs, ys, samples: values }, a, b, c) {
  const { width, components, samples } = picture;
  const ax = xs[a], ay = ys[a], bx = xs[b], by = ys[b], cx = xs[c], cy = ys[c];
  const abx = bx - ax, aby = by - ay, acx = cx - ax, acy = cy - ay;
  const area = abx * acy - aby * acx;
  const bottom = Math.min(ay, by, cy), top = Math.max(ay, by, cy);
  for (let y = bottom; y <= top; y++) {
    const [left, right] = span(y, ax, ay, bx, by, cx, cy);
    if (left > right) continue;
    const first = (y * width + left) * components;
    for (let k = 0; k < components; k++) {
      const va = values[a * components + k];
      const ab = values[b * components + k] - va, ac = values[c * components + k] - va;
      // The value times the area, along the row.
      const perColumn = ab * acy - ac * aby, perRow = ac * abx - ab * acx;
      let numerator = va * area + perColumn * (left - ax) + perRow * (y - ay);
      let at = first + k;
      for (let x = left; x <= right; x++) {
        samples[at] = Math.floor((2 * numerator + area) / (2 * area));
        numerator += perColumn;
        at += components;
      }
    }
  }
}

/**
 * The first and last lattice points of a row inside a counter-clockwise triangle or on its edges.
 * @param {number} y
 * @param {number} ax @param {number} ay @param {number} bx @param {number} by
 * @param {number} cx @param {number} cy
 * @returns {[number, number]}
 */
function span(y, ax, ay, bx, by, cx, cy) {
  let left = -Infinity, right = Infinity;
  /** @param {number} px @param {number} py @param {number} qx @param {number} qy */
  const clip = (px, py, qx, qy) => {
    const dy = qy - py, dx = qx - px;
    if (dy === 0) return;
    const x = px + ((y - py) * dx) / dy;
    // Upwards is the right side, downwards the left one, interior at the left of each edge.
    if (dy > 0) right = Math.min(right, Math.floor(exact(x, px, py, dx, dy, y)));
    else left = Math.max(left, Math.ceil(exact(x, px, py, dx, dy, y)));
  };
  clip(ax, ay, bx, by);
  clip(bx, by, cx, cy);
  clip(cx, cy, ax, ay);
  return [left, right];
}

/**
 * Where an edge meets a row: the integer itself where the division has missed it.
 * @param {number} x @param {number} px @param {number} py
 * @param {number} dx @param {number} dy @param {number} y
 */
function exact(x, px, py, dx, dy, y) {
  const nearest = Math.round(x);
  return (nearest - px) * dy === (y - py) * dx ? nearest : x;
}

/**
 * Sum of squared differences over all pixels and components.
 * @param {Picture} original @param {Picture} approximation
 */
export function squaredError(original, approximation) {
  let sum = 0;
  const a = original.samples, b = approximation.samples;
  for (let i = 0; i < a.length; i++) sum += (a[i] - b[i]) ** 2;
  return sum;
}

/**
 * Peak signal-to-noise ratio in decibels; infinite for a perfect copy.
 * @param {Picture} original @param {Picture} approximation
 */
export function psnrDb(original, approximation) {
  const mse = squaredError(original, approximation) / original.samples.length;
  return 20 * Math.log10((2 ** original.precision - 1) / Math.sqrt(mse));
}
