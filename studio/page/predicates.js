// Which diagonal a quadrilateral of lattice points takes, exactly.
//
// Coordinates are integers, so products of 53 bits and fewer are exact as numbers; where they may
// not be, the same is done with whole numbers of any length.

/**
 * Twice the signed area of the triangle a b c: positive when it turns counter-clockwise.
 * @param {number} ax @param {number} ay @param {number} bx @param {number} by
 * @param {number} cx @param {number} cy
 */
export function orientation(ax, ay, bx, by, cx, cy) {
  return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
}

/**
 * Whether d lies inside the circle of the counter-clockwise triangle a b c, where cocircular points
 * are decided by the preferred directions (1, 0), then (1, 1).
 * @param {number} ax @param {number} ay @param {number} bx @param {number} by
 * @param {number} cx @param {number} cy @param {number} dx @param {number} dy
 */
export function inCircle(ax, ay, bx, by, cx, cy, dx, dy) {
  const acx = ax - cx, acy = ay - cy, bcx = bx - cx, bcy = by - cy;
  const adx = ax - dx, ady = ay - dy, bdx = bx - dx, bdy = by - dy;
  const sineC = acx * bcy - acy * bcx, cosineC = acx * bcx + acy * bcy;
  const sineD = bdx * ady - bdy * adx, cosineD = bdx * adx + bdy * ady;
  // The sine of the sum of the angles at c and d in which a b is seen.
  const left = sineC * cosineD, right = cosineC * sineD;
  const sum = left + right, size = Math.abs(left) + Math.abs(right);
  if (size < 2 ** 53) return sum === 0 ? preferred(adx, ady, bdx, bdy, cx - dx, cy - dy) : sum < 0;
  if (Math.abs(sum) > size * 2 ** -50) return sum < 0;
  const exact = BigInt(sineC) * BigInt(cosineD) + BigInt(cosineC) * BigInt(sineD);
  return exact === 0n ? preferred(adx, ady, bdx, bdy, cx - dx, cy - dy) : exact < 0n;
}

/**
 * The answer for cocircular points, of three of them relative to the fourth.
 * @param {number} ax @param {number} ay @param {number} bx @param {number} by
 * @param {number} cx @param {number} cy
 */
function preferred(ax, ay, bx, by, cx, cy) {
  const first = lifted(ax * ax, bx * bx, cx * cx, ax, ay, bx, by, cx, cy);
  if (first !== 0) return first < 0;
  return lifted((ax + ay) ** 2, (bx + by) ** 2, (cx + cy) ** 2, ax, ay, bx, by, cx, cy) < 0;
}

/**
 * The sign of the determinant of the rows (x, y, height).
 * @param {number} ha @param {number} hb @param {number} hc
 * @param {number} ax @param {number} ay @param {number} bx @param {number} by
 * @param {number} cx @param {number} cy
 */
function lifted(ha, hb, hc, ax, ay, bx, by, cx, cy) {
  const a = bx * cy - by * cx, b = ax * cy - ay * cx, c = ax * by - ay * bx;
  const size = ha * Math.abs(a) + hb * Math.abs(b) + hc * Math.abs(c);
  if (size < 2 ** 53) return ha * a - hb * b + hc * c;
  const exact = BigInt(ha) * BigInt(a) - BigInt(hb) * BigInt(b) + BigInt(hc) * BigInt(c);
  return exact < 0n ? -1 : exact > 0n ? 1 : 0;
}
