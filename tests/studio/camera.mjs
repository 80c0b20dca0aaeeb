// Pictures as cameras write them: JPEG files with a thumbnail within their Exif data.

/** A JPEG picture, painted by the page and perhaps of one colour: of the page's helpers, as bytes. */
export async function jpegOf(page, width, height, color = "") {
  const base64 = await page.evaluate(async ([width, height, color]) => {
    const canvas = new OffscreenCanvas(width, height), context = canvas.getContext("2d");
    if (color) {
      context.fillStyle = color;
      context.fillRect(0, 0, width, height);
    } else {
      const painted = await createImageBitmap(await studio.helpers.painted("spheres", Math.min(width, 800), Math.min(height, 600)));
      context.drawImage(painted, 0, 0, width, height);
    }
    const bytes = new Uint8Array(await (await canvas.convertToBlob({ type: "image/jpeg", quality: 0.92 })).arrayBuffer());
    let text = "";
    for (let at = 0; at < bytes.length; at += 8192) text += String.fromCharCode(...bytes.subarray(at, at + 8192));
    return btoa(text);
  }, [width, height, color]);
  return Buffer.from(base64, "base64");
}

/** The same picture with a thumbnail, and with how it is to be turned: 1 for upright, 6 for a quarter to the right. */
export function withThumbnail(jpeg, thumbnail, orientation = 1) {
  const field = (tag, type, value) => {
    const bytes = Buffer.alloc(12);
    bytes.writeUInt16LE(tag, 0);
    bytes.writeUInt16LE(type, 2);
    bytes.writeUInt32LE(1, 4);
    if (type === 3) bytes.writeUInt16LE(value, 8);
    else bytes.writeUInt32LE(value, 8);
    return bytes;
  };
  const directory = (fields, next) => {
    const head = Buffer.alloc(2), tail = Buffer.alloc(4);
    head.writeUInt16LE(fields.length, 0);
    tail.writeUInt32LE(next, 0);
    return Buffer.concat([head, ...fields, tail]);
  };
  const tiff = Buffer.concat([
    Buffer.from("II*\0\x08\0\0\0", "latin1"),
    directory([field(0x112, 3, orientation)], 26),
    directory([field(0x201, 4, 56), field(0x202, 4, thumbnail.length)], 0),
    thumbnail,
  ]);
  const head = Buffer.alloc(4);
  head.writeUInt16BE(0xffe1, 0);
  head.writeUInt16BE(8 + tiff.length, 2);
  return Buffer.concat([jpeg.subarray(0, 2), head, Buffer.from("Exif\0\0"), tiff, jpeg.subarray(2)]);
}
