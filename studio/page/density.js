// The density by which error diffusion places sample points: the maximum over the components of
// the magnitude of the second derivative in the direction where it is largest (MMSODD), after
// binomial smoothing of order 3, zero beyond the border.

/** @typedef {import("./picture.js").Picture} Picture */

const SMOOTH = [0.25, 0.5, 0.25];
const SECOND = [0.25, 0, -0.5, 0, 0.25];
const MIXED = [0.125, 0.25, 0, -0.25, -0.125];

/**
 * The density of each pixel, rows from the bottom, the largest being 1.
 * @param {Picture} picture
 */
export function densityOf(picture) {
  const { width, height, components, samples } = picture;
  const density = new Float32Array(width * height);
  const plane = new Float32Array(width * height);
  for (let c = 0; c < components; c++) {
    for (let i = 0; i < plane.length; i++) plane[i] = samples[i * components + c];
    const xx = filtered(plane, width, height, SECOND, SMOOTH);
    const yy = filtered(plane, width, height, SMOOTH, SECOND);
    const xy = filtered(plane, width, height, MIXED, MIXED);
    for (let i = 0; i < plane.length; i++) {
      const mean = (xx[i] + yy[i]) / 2, half = (xx[i] - yy[i]) / 2;
      density[i] = Math.max(density[i], Math.abs(mean) + Math.hypot(half, xy[i]));
    }
  }
  let most = 1e-12;
  for (const value of density) most = Math.max(most, value);
  for (let i = 0; i < density.length; i++) density[i] /= most;
  return density;
}

/**
 * A plane filtered along its rows, then along its columns, zero beyond the border.
 * @param {Float32Array} plane @param {number} width @param {number} height
 * @param {number[]} alongRows @param {number[]} alongColumns
 */
function filtered(plane, width, height, alongRows, alongColumns) {
  const rows = new Float32Array(plane.length), columns = new Float32Array(plane.length);
  accumulate(plane, rows, alongRows, 1, width, (i) => i % width);
  accumulate(rows, columns, alongColumns, width, height, (i) => Math.floor(i / width));
  return columns;
}

/**
 * @param {Float32Array} from @param {Float32Array} to @param {number[]} weights
 * @param {number} stride @param {number} length @param {(i: number) => number} place
 */
function accumulate(from, to, weights, stride, length, place) {
  const reach = (weights.length - 1) / 2;
  for (let i = 0; i < from.length; i++) {
    const at = place(i);
    let sum = 0;
    for (let k = -reach; k <= reach; k++) {
      if (at + k >= 0 && at + k < length) sum += weights[k + reach] * from[i + k * stride];
    }
    to[i] = sum;
  }
}
