// A PNG of three components: what a canvas writes has a fourth, which would be meshed too.

/** @type {Uint32Array} */
const REMAINDERS = Uint32Array.from({ length: 256 }, (_, byte) => {
  let remainder = byte;
  for (let bit = 0; bit < 8; bit++) remainder = remainder & 1 ? (remainder >>> 1) ^ 0xedb88320 : remainder >>> 1;
  return remainder;
});

/**
 * @param {number} width @param {number} height
 * @param {Uint8ClampedArray} rgba  Four bytes a pixel, rows from the top.
 */
export async function writtenPng(width, height, rgba) {
  const head = new DataView(new ArrayBuffer(13));
  head.setUint32(0, width);
  head.setUint32(4, height);
  // Eight bits of red, green and blue.
  head.setUint16(8, 0x0802);
  const rows = filtered(width, height, rgba);
  const stream = new Blob([rows]).stream().pipeThrough(new CompressionStream("deflate"));
  const data = new Uint8Array(await new Response(stream).arrayBuffer());
  const signature = Uint8Array.of(0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a);
  const parts = [signature, chunk("IHDR", new Uint8Array(head.buffer)), chunk("IDAT", data), chunk("IEND", new Uint8Array())];
  return new Blob(parts, { type: "image/png" });
}

/** The rows, each as it differs from the one above. @param {number} width @param {number} height @param {Uint8ClampedArray} rgba */
function filtered(width, height, rgba) {
  const each = 1 + 3 * width;
  const rows = new Uint8Array(each * height);
  for (let y = 0; y < height; y++) {
    rows[y * each] = 2;
    for (let x = 0; x < width; x++) {
      for (let k = 0; k < 3; k++) {
        const at = 4 * (y * width + x) + k;
        rows[y * each + 1 + 3 * x + k] = rgba[at] - (y > 0 ? rgba[at - 4 * width] : 0);
      }
    }
  }
  return rows;
}

/** @param {string} name @param {Uint8Array} data */
function chunk(name, data) {
  const bytes = new Uint8Array(12 + data.length);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, data.length);
  bytes.set(new TextEncoder().encode(name), 4);
  bytes.set(data, 8);
  let remainder = 0xffffffff;
  for (const byte of bytes.subarray(4, 8 + data.length)) remainder = (remainder >>> 8) ^ REMAINDERS[(remainder ^ byte) & 255];
  view.setUint32(8 + data.length, ~remainder);
  return bytes;
}
