// The mesh in three dimensions: what is seen is the file that the service writes.

import * as api from "./api.js";
import { readGlb } from "./glb.js";
import { parametersOf } from "./relief.js";

/** The height of the file that is fetched, in percent; the graphics stretch it to the one asked for. */
const FETCHED_PERCENT = 10;

/** Shows the mesh and the size that are seen, unless they are shown already. @param {import("./app.js").Studio} studio */
export async function showSolid(studio) {
  const { machine, stage, stage: { renderer, scene, solid }, token, tracks: [track] } = studio;
  if (!scene.relief || !machine.hasMesh || !renderer.relief) return;
  renderer.relief.stretch = solid.percent / FETCHED_PERCENT;
  stage.redraw();
  const path = track.meshPath("glb", {
    ...parametersOf({ ...solid, percent: FETCHED_PERCENT }, renderer, renderer.levels, false),
    compression: "none", texture: "none", center: "false", up: "z",
  });
  if (path === null) {
    await studio.run();
    return;
  }
  if (path === studio.reliefPath) return;
  studio.reliefPath = path;
  try {
    const response = await api.request(path, { signal: token.signal });
    const surface = readGlb(await response.arrayBuffer());
    if (path !== studio.reliefPath || !machine.isCurrent(token)) return;
    renderer.relief.set(surface);
    stage.redraw();
  } catch (error) {
    if (token.signal.aborted) return;
    studio.reliefPath = "";
    stage.setRelief(false);
    machine.tell(/** @type {Error} */ (error));
  }
}
