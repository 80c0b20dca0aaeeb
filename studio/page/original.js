// The original's samples as the service reads them, where the browser's are not enough.

import { bitmapOf, fromService, levelsOf, samplesOf } from "./picture.js";

/** @typedef {import("./app.js").Studio} Studio */
/** @typedef {import("./picture.js").Shape} Shape */

/** Finds them for a picture of more than 8 bits, and for one that the browser cannot show. @param {Studio} studio @param {import("./state.js").Token} token */
export async function findSamples(studio, token) {
  const { source, form, machine, stage, tracks: [{ job }] } = studio;
  await source?.looked;
  if (!source || source !== studio.source || !job?.image) return;
  const shape = /** @type {Shape} */ (job.image);
  form?.allow(shape.components >= 3 ? 3 : 1);
  source.picture ??= source.bitmap && samplesOf(source.bitmap, shape);
  if (!source.picture && (shape.precision > 8 || !source.bitmap)) {
    const picture = await fromService(job.id, studio.tracks[0].reading(), token.signal).catch(() => null);
    if (source !== studio.source) return;
    source.picture = picture;
    source.levels = levelsOf(picture ?? grayOf(source.bitmap, shape));
    if (picture) source.bitmap = bitmapOf(picture, source.levels);
    else if (source.bitmap) source.bitmap = bitmapOf(grayOf(source.bitmap, shape), source.levels);
    stage.renderer.levels = source.levels;
    if (machine.phase === "missing" && source.bitmap) machine.become(token, "ready");
    studio.showSource(source);
    studio.restoreMeshes();
  }
  if (stage.scene.layer === "density") await orderDensity(studio);
}

/** What the browser sees of a gray picture of more than 8 bits. @param {import("./picture.js").Bitmap | null} bitmap @param {Shape} shape */
function grayOf(bitmap, { components }) {
  const { width, height, rgba } = bitmap ?? { width: 1, height: 1, rgba: new Uint8Array(4) };
  if (components > 2) return { width, height, components: 4, precision: 8, samples: rgba };
  // As 9 bits, for the range is that of a picture of more than 8.
  const samples = Uint16Array.from({ length: width * height }, (_, i) => 2 * rgba[4 * i]);
  return { width, height, components: 1, precision: 9, samples };
}

/** Has the density drawn, for which the samples must be there. @param {Studio} studio */
export async function orderDensity({ source, tracks: [track], token }) {
  if (!source) return;
  if (!source.picture && track.job) source.picture = await fromService(track.job.id, track.reading(), token.signal).catch(() => null);
  const picture = source.picture ?? (source.bitmap && grayOf(source.bitmap, { width: 0, height: 0, components: 4, precision: 8 }));
  if (picture) track.order({ kind: "density", picture });
}
