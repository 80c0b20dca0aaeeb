// The state of the studio as the page shows it: every part that depends on it is put here.

import { addressOf } from "./address.js";
import * as api from "./api.js";
import { byId, counted, decibels, sized } from "./dom.js";
import * as panels from "./panels.js";
import { likeness, suited } from "./presets.js";

/** @typedef {import("./app.js").Studio} Studio */
/** @typedef {import("./track.js").Track} Track */

const LAYER_NAMES = { mesh: "mesh", original: "original", error: "differences", density: "detail map", none: "lines" };

/** Shows what is quick to show. @param {Studio} studio */
export function render(studio) {
  const { machine, stage, source, tracks: [track], seen, form } = studio;
  const hasOriginal = Boolean(source?.bitmap), hasMesh = track.size > 0;
  stage.show({ hasOriginal, hasMesh, isCompared: seen.length > 1 });
  byId("empty", HTMLDivElement).hidden = hasOriginal || hasMesh || machine.isBusy;
  byId("first-sight", HTMLImageElement).hidden = hasOriginal || hasMesh || !studio.sight.isThere;
  byId("stage-box", HTMLDivElement).dataset.phase = machine.phase;
  panels.showProgress(machine, seen.find(({ isWorking }) => isWorking) ?? track);
  showError(studio);
  showFigures(studio);
  showLabels(studio);
  panels.showPresets(studio.presets, studio.preset, source ? suited(source.nature) : "");
  panels.showLook(stage.scene.look);
  byId("download-button", HTMLButtonElement).disabled = !machine.hasMesh;
  byId("picture-note", HTMLParagraphElement).textContent = noteOfPicture(studio);
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("#samples button"))) {
    button.setAttribute("aria-pressed", String(button.dataset.sample === source?.sample));
  }
  if (form) byId("run", HTMLButtonElement).textContent = machine.phase === "cancelled" ? "Start again" : "Make it again";
}

/** @param {Studio} studio */
function showError({ machine: { error } }) {
  byId("failure", HTMLDivElement).hidden = error === null;
  const more = /** @type {{ more?: string } | null} */ (error)?.more ?? "";
  if (!error) return;
  byId("failure-text", HTMLSpanElement).textContent = error.message;
  const details = byId("failure-more", HTMLDetailsElement);
  details.hidden = more === "";
  byId("failure-detail", HTMLSpanElement).textContent = more;
}

/** @param {Studio} studio */
function showFigures({ tracks: [track], seen, source, machine, stage, curve }) {
  /** @param {string} id @param {string} text */
  const put = (id, text) => (byId(id, HTMLElement).textContent = text);
  put("figure-likeness", track.size ? likeness(track.psnr) : "–");
  put("figure-psnr", track.size ? decibels(track.psnr) : "");
  put("figure-vertices", track.size ? counted(track.size) : "–");
  put("figure-faces", track.faceCount ? counted(track.faceCount) : "–");
  const isWhole = machine.hasMesh && track.size > 0;
  if (!isWhole) put("figure-bytes", "–");
  else if (byId("figure-bytes", HTMLElement).dataset.of !== keyOf(track)) put("figure-bytes", `≈ ${sized(bytesOf(track))}`);
  put("size-note", noteOfSize(track, machine));
  curve.update(seen, track.stage === "final" && !track.isProgressive && source !== null);
  const label = track.size
    ? `${source?.name ?? "Picture"} as a mesh of ${counted(track.size)} vertices: ${likeness(track.psnr)}, ${decibels(track.psnr)}`
    : source?.bitmap ? `${source.name}, not a mesh yet` : "No picture yet";
  stage.canvas.setAttribute("aria-label", label);
}

/** @param {Track} track */
const keyOf = ({ job, size }) => `${job?.id} ${size}`;

/** About the bytes of a pmesh of the size that is seen. @param {Track} track */
function bytesOf({ points, size }) {
  if (!points) return 0;
  const bits = Math.log2((Math.E * points.width * points.height) / size) + 0.62 * points.precision * points.components;
  return Math.round(24 + (size * bits) / 8);
}

/** @param {Track} track @param {import("./state.js").Machine} machine */
function noteOfSize(track, { phase }) {
  if (phase === "cancelled") return track.size ? "Stopped: this is a rough preview. Start again for the whole mesh." : "Stopped. Start again when you like.";
  if (track.stage === "preview") return "A rough preview: the mesh itself follows.";
  if (track.stage === "final" && !track.isProgressive) return "One size at a time: let go of the slider to make another.";
  return track.size ? "Drag to change the detail – it's instant." : "";
}

/** @param {Studio} studio */
function noteOfPicture({ source, machine }) {
  if (!source) return "Your picture is processed on this server and kept for 24 hours. Only people with its link can see it.";
  if (machine.phase === "missing") return "The original picture is not here, only its mesh. Choose the file to compare or to make another.";
  const { bitmap } = source;
  if (machine.phase === "failed") return `${source.name}.`;
  const sides = bitmap ? `, ${counted(bitmap.fullWidth)} × ${counted(bitmap.fullHeight)} pixels` : "";
  return `${source.name}${sides}. Processed on this server and kept for 24 hours. Only people with its link can see it.`;
}

/** @param {Studio} studio */
function showLabels({ tracks: [a, b], seen, stage: { scene } }) {
  const isCompared = seen.length > 1, isSplit = scene.split !== null && !isCompared && !scene.relief && a.size > 0;
  const first = byId("label-a", HTMLParagraphElement), second = byId("label-b", HTMLParagraphElement);
  first.hidden = second.hidden = !(isCompared || isSplit);
  first.textContent = isCompared ? `A: ${a.parameters.method ?? ""}, ${decibels(a.psnr)}` : "original";
  second.textContent = isCompared ? `B: ${b.parameters.method ?? ""}, ${decibels(b.psnr)}` : LAYER_NAMES[scene.layer];
}

/** Shows what waits until the hand rests. @param {Studio} studio */
export function settled(studio) {
  const { seen, tracks: [track], source } = studio;
  panels.showNumbers(seen);
  const name = source?.name ?? "picture.png";
  byId("curl", HTMLPreElement).textContent = track.job ? panels.curlOf(track, name) : "";
  byId("embed", HTMLPreElement).textContent = panels.embedOf(track, name);
  byId("address", HTMLPreElement).textContent = addressOf(studio);
  byId("link-end", HTMLParagraphElement).textContent = source?.sample ? "This link makes the same mesh anywhere." : panels.endOf(track.job);
  measureBytes(studio, track).catch(() => {});
}

/** Asks the service how many bytes the mesh that is seen takes. @param {Studio} studio @param {Track} track */
async function measureBytes({ machine, token }, track) {
  const path = machine.hasMesh && track.points && !track.points.faces ? track.meshPath("pmesh") : null;
  const figure = byId("figure-bytes", HTMLElement), key = keyOf(track);
  if (path === null || figure.dataset.of === key) return;
  const length = Number((await api.request(path, { method: "HEAD", signal: token.signal })).headers.get("content-length"));
  if (!length || key !== keyOf(track)) return;
  figure.dataset.of = key;
  figure.textContent = sized(length);
}
