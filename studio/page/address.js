// The address of a view: what is asked for and what is seen, so that it can be had again.

import { lookOf, textOf } from "./looks.js";

/** @typedef {import("./stage.js").Stage} Stage */

const MARKS = /** @type {const} */ (["wireframe", "points", "smooth"]);

/** Shows what an address asks to see. @param {URLSearchParams} asked @param {Stage} stage */
export function showAsked(asked, stage) {
  const layer = asked.get("layer");
  if (layer && document.querySelector(`input[name=layer][value="${CSS.escape(layer)}"]`)) {
    stage.setLayer(/** @type {import("./renderer.js").Scene["layer"]} */ (layer));
  }
  const shown = (asked.get("show") ?? "").split(" ");
  for (const name of MARKS) if (shown.includes(name)) stage.toggle(name, true);
  const split = Number(asked.get("split"));
  if (split > 0 && split < 1) stage.setSplit(split);
  stage.scene.look = lookOf(asked.get("look") ?? "");
}

/**
 * Where a view can be had again: of our pictures anywhere, of others while the job is kept.
 * @param {import("./app.js").Studio} studio
 */
export function addressOf({ source, stage: { scene, view }, tracks: [track], form, preset }) {
  const asked = new URLSearchParams();
  if (source?.sample && !source.weights && track.job) {
    asked.set("sample", source.sample);
    for (const [name, value] of Object.entries(track.parameters)) if (name !== "format") asked.set(name, value);
  } else if (track.job) {
    asked.set("job", track.job.id);
  }
  if (preset && track.job) asked.set("preset", preset);
  const look = textOf(scene.look);
  if (look) asked.set("look", look);
  if (form?.comparedMethod) asked.set("compare", form.comparedMethod);
  if (track.size && track.size < track.most) asked.set("n", String(track.size));
  if (scene.layer !== "mesh") asked.set("layer", scene.layer);
  const marks = MARKS.filter((name) => scene[name]);
  if (marks.length) asked.set("show", marks.join(" "));
  if (scene.split !== null) asked.set("split", scene.split.toFixed(3));
  if (scene.relief) asked.set("relief", "1");
  if (!view.isFitted) asked.set("view", [scene.x.toFixed(1), scene.y.toFixed(1), scene.zoom.toFixed(4)].join(" "));
  if (document.documentElement.dir === "rtl") asked.set("dir", "rtl");
  const query = asked.toString();
  return `${location.origin}/${query ? `?${query}` : ""}`;
}
