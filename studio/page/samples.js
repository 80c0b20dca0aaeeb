// Pictures of our own, computed: nothing is loaded for them.

/** A colour of 0 to 1. @typedef {[number, number, number]} Color */
/** @typedef {(x: number, y: number) => Color} Painter  Places from -1 to 1 across, 0 at the middle, y up. */

/** @type {Record<string, Painter>} */
export const SAMPLES = { lake, spheres, bloom };

/**
 * The picture of a painter, as the bytes of a canvas: rows from the top, smooth edges by two
 * samples a pixel.
 * @param {Painter} paint @param {number} width @param {number} height
 */
export function painted(paint, width, height) {
  const bytes = new Uint8ClampedArray(4 * width * height);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      const sum = [0, 0, 0];
      for (const [dx, dy] of [[0.25, 0.7], [0.75, 0.3]]) {
        const color = paint((2 * (column + dx)) / width - 1, (height - 2 * (row + dy)) / width);
        for (let k = 0; k < 3; k++) sum[k] += color[k];
      }
      const at = 4 * (row * width + column);
      for (let k = 0; k < 3; k++) bytes[at + k] = 127.5 * sum[k];
      bytes[at + 3] = 255;
    }
  }
  return bytes;
}

/** @param {number} a @param {number} b @param {number} t */
const mix = (a, b, t) => a + (b - a) * t;
/** @param {number} t */
const clamp = (t) => Math.min(1, Math.max(0, t));
/** @param {number} low @param {number} high @param {number} x */
const step = (low, high, x) => {
  const t = clamp((x - low) / (high - low));
  return t * t * (3 - 2 * t);
};
/** @param {Color} a @param {Color} b @param {number} t @returns {Color} */
const blend = (a, b, t) => [mix(a[0], b[0], t), mix(a[1], b[1], t), mix(a[2], b[2], t)];

/** Smooth noise of 0 to 1. @param {number} x @param {number} y */
function noise(x, y) {
  const column = Math.floor(x), row = Math.floor(y);
  const u = step(0, 1, x - column), v = step(0, 1, y - row);
  /** @param {number} i @param {number} j */
  const at = (i, j) => {
    let h = Math.imul(column + i, 374761393) + Math.imul(row + j, 668265263);
    h = Math.imul(h ^ (h >>> 13), 1274126177);
    return ((h ^ (h >>> 16)) >>> 0) / 2 ** 32;
  };
  return mix(mix(at(0, 0), at(1, 0), u), mix(at(0, 1), at(1, 1), u), v);
}

/** Noise of several sizes. @param {number} x @param {number} y @param {number} octaves */
function rough(x, y, octaves) {
  let sum = 0, weight = 0.5;
  for (let octave = 0; octave < octaves; octave++) {
    sum += weight * noise(x, y);
    [x, y, weight] = [2.03 * x + 17, 2.03 * y + 9, weight / 2];
  }
  return sum;
}

/** Mountains and an evening sky, and both again in the water. @type {Painter} */
function lake(x, y) {
  const shore = -0.2;
  if (y >= shore) return land(x, y);
  const depth = shore - y;
  const ripple = (noise(6 * x, 90 * y) - 0.5) * (0.02 + 0.12 * depth);
  const seen = land(x + ripple * 0.4, shore + depth * 1.15 + ripple);
  const water = blend(seen, [0.05, 0.09, 0.2], 0.28 + 0.3 * depth);
  const glint = step(0.72, 0.9, noise(9 * x, 120 * y)) * Math.exp(-((x - 0.28) ** 2) / (0.01 + 0.05 * depth)) * 0.5;
  return blend(water, [1, 0.82, 0.55], glint);
}

/** @type {Painter} */
function land(x, y) {
  const up = clamp((y + 0.2) / 0.95);
  let color = up < 0.35 ? blend([1, 0.66, 0.38], [0.89, 0.4, 0.45], up / 0.35) : blend([0.89, 0.4, 0.45], [0.13, 0.15, 0.4], clamp((up - 0.35) / 0.5));
  const sun = Math.hypot(x - 0.28, y - 0.06);
  color = blend(color, [1, 0.85, 0.5], 0.75 * Math.exp(-9 * sun));
  color = blend(color, [1, 0.97, 0.84], step(0.092, 0.086, sun));
  const cloud = step(0.46, 0.72, rough(2.2 * x + 3, 9 * y, 4)) * step(0.02, 0.3, y) * 0.55;
  color = blend(color, [1, 0.72, 0.6], cloud);
  if (noise(70 * x, 70 * y) > 0.985) color = blend(color, [1, 1, 1], 0.7 * step(0.45, 0.7, y));
  /** @type {[number, number, number, Color][]} */
  const ridges = [
    [0.16, 1.5, 3.1, [0.55, 0.33, 0.47]],
    [0.04, 2.1, 8.4, [0.32, 0.2, 0.38]],
    [-0.08, 3.4, 1.7, [0.14, 0.1, 0.24]],
  ];
  for (const [height, frequency, seed, tone] of ridges) {
    const top = height + 0.42 * (rough(frequency * x + seed, seed, 5) - 0.48);
    if (y >= top) continue;
    const light = step(0.3, 0.75, rough(9 * x + seed, 9 * (y - top) + 5 * x, 3));
    color = blend(tone, [1, 0.6, 0.42], 0.22 * light * Math.exp(-6 * (top - y)) + 0.12 * clamp(1 - (y + 0.2) / 0.4) * height * 4);
  }
  return color;
}

/** @typedef {[number, number, number]} Vector */
/** @param {Vector} a @param {Vector} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vector} a @param {Vector} b @param {number} t @returns {Vector} */
const along = (a, b, t) => [a[0] + b[0] * t, a[1] + b[1] * t, a[2] + b[2] * t];
/** @param {Vector} a @returns {Vector} */
const unit = (a) => along([0, 0, 0], a, 1 / Math.sqrt(dot(a, a)));

/** Place, radius, colour, mirroring. @type {[Vector, number, Color, number][]} */
const BALLS = [
  [[-0.62, 0.5, 0.35], 0.5, [0.95, 0.36, 0.22], 0.18],
  [[0.42, 0.62, 0.75], 0.62, [0.75, 0.8, 0.86], 0.72],
  [[0.12, 0.24, -0.42], 0.24, [0.16, 0.58, 0.62], 0.25],
  [[-0.2, 0.14, -0.72], 0.14, [0.97, 0.8, 0.3], 0.12],
  [[0.86, 0.2, -0.3], 0.2, [0.5, 0.3, 0.75], 0.3],
];
const SUN = unit([-0.6, 0.9, -0.7]);

/** Balls that mirror each other on a floor of marble. @type {Painter} */
function spheres(x, y) {
  return traced([0, 0.75, -3.2], unit([x * 0.55, y * 0.55 - 0.08, 1]), 3);
}

/** @param {Vector} from @param {Vector} direction @param {number} depth @returns {Color} */
function traced(from, direction, depth) {
  const hit = nearest(from, direction);
  const floor = direction[1] < 0 ? -from[1] / direction[1] : Infinity;
  if (floor < hit.distance) return floorAt(along(from, direction, floor), direction, floor, depth);
  if (!hit.ball) return sky(direction);
  const [center, , tone, mirroring] = hit.ball;
  const at = along(from, direction, hit.distance);
  const normal = unit(along(at, center, -1));
  const facing = -dot(direction, normal);
  const away = along(direction, normal, 2 * facing);
  const lit = Math.max(0, dot(normal, SUN)) * (nearest(along(at, normal, 1e-4), SUN).ball ? 0.15 : 1);
  const shade = 0.22 + 0.16 * normal[1] + 0.8 * lit;
  let color = /** @type {Color} */ (tone.map((value) => value * shade));
  const shine = mirroring + (1 - mirroring) * 0.6 * (1 - clamp(facing)) ** 4;
  if (depth > 0) color = blend(color, traced(along(at, normal, 1e-4), away, depth - 1), shine);
  return blend(color, [1, 1, 1], clamp(dot(away, SUN)) ** 60 * 0.9 * (lit > 0 ? 1 : 0));
}

/** @param {Vector} from @param {Vector} direction */
function nearest(from, direction) {
  let distance = Infinity, ball = null;
  for (const candidate of BALLS) {
    const to = along(from, candidate[0], -1);
    const half = dot(to, direction), rest = half * half - dot(to, to) + candidate[1] ** 2;
    if (rest < 0) continue;
    const t = -half - Math.sqrt(rest);
    if (t > 1e-4 && t < distance) [distance, ball] = [t, candidate];
  }
  return { distance, ball };
}

/** @param {Vector} at @param {Vector} direction @param {number} distance @param {number} depth @returns {Color} */
function floorAt(at, direction, distance, depth) {
  const vein = Math.abs(Math.sin(3 * at[0] + 2 * at[2] + 7 * rough(1.7 * at[0] + 40, 1.7 * at[2] + 40, 4)));
  const isDark = (Math.floor(at[0] * 1.6 + 100) + Math.floor(at[2] * 1.6 + 100)) % 2 === 0;
  /** @type {Color} */
  const tile = isDark ? [0.16, 0.2, 0.27] : [0.86, 0.84, 0.8];
  let color = blend(tile, isDark ? [0.4, 0.5, 0.6] : [0.55, 0.53, 0.55], 0.5 * (1 - vein) ** 3);
  let open = 1;
  for (const [center, radius] of BALLS) open *= 1 - 0.65 * Math.exp(-(((at[0] - center[0]) ** 2 + (at[2] - center[2]) ** 2) / (0.5 * radius ** 2)));
  const lit = nearest(along(at, [0, 1e-3, 0], 1), SUN).ball ? 0.3 : 1;
  color = /** @type {Color} */ (color.map((value) => value * (0.3 * open + 0.75 * lit)));
  if (depth > 0) color = blend(color, traced(along(at, [0, 1e-4, 0], 1), [direction[0], -direction[1], direction[2]], depth - 1), 0.14);
  return blend(color, sky(direction), step(4, 14, distance));
}

/** @param {Vector} direction @returns {Color} */
function sky(direction) {
  const up = clamp(direction[1] * 1.6 + 0.12);
  return blend([0.93, 0.89, 0.84], [0.32, 0.52, 0.76], Math.sqrt(up));
}

/** A flower of many petals. @type {Painter} */
function bloom(x, y) {
  const angle = Math.atan2(y, x), radius = Math.hypot(x, y);
  let color = blend([0.04, 0.16, 0.16], [0.1, 0.32, 0.24], rough(3 * x + 5, 3 * y + 5, 5));
  for (let ring = 6; ring >= 0; ring--) {
    const count = 8 + (ring % 2), turn = ring * 0.47 + 0.2;
    const length = 0.16 + 0.095 * ring;
    const wave = Math.cos(count * (angle + turn) + 0.5 * Math.sin(6 * radius));
    const edge = length * (0.72 + 0.28 * Math.sqrt(Math.max(0, 0.5 + 0.5 * wave)));
    if (radius > edge) continue;
    const inside = radius / edge;
    const tone = blend([1, 0.82, 0.42], [0.86, 0.16, 0.42], clamp(0.16 * ring + 0.35 * inside));
    const vein = 0.08 * Math.cos(7 * count * (angle + turn)) * step(0.3, 0.9, inside);
    const light = 0.5 + 0.42 * wave * step(0.25, 1, inside) * 0.6 + 0.35 * inside ** 2 + vein;
    color = blend([0.3, 0.02, 0.16], tone, clamp(light + 0.12));
  }
  const heart = Math.hypot(x, y);
  if (heart < 0.1) {
    const seed = 0.5 + 0.5 * Math.cos(60 * heart + 3) * Math.cos(14 * angle);
    color = blend([0.36, 0.16, 0.03], [1, 0.78, 0.24], 0.35 + 0.65 * seed);
  }
  const drop = Math.hypot(x - 0.31, y - 0.2) / 0.05;
  if (drop < 1) color = blend(blend(color, [1, 1, 1], 0.18 + 0.3 * drop ** 3), [1, 1, 1], step(0.25, 0.1, Math.hypot(x - 0.296, y - 0.216) / 0.05));
  return color;
}
