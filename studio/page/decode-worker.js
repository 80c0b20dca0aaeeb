// Decodes files beside the page, and looks at what kind of pictures they are.

import { decoded, natureOf } from "./decode.js";

addEventListener("message", async ({ data: { id, file, maxSide, maxPixels } }) => {
  const bitmap = await decoded(file, maxSide, maxPixels).catch(() => null);
  const nature = bitmap && natureOf(bitmap);
  postMessage({ id, bitmap, nature }, bitmap ? { transfer: [bitmap.rgba.buffer] } : {});
});
