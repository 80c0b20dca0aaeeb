// What stands beside the picture: progress, numbers, outcomes, looks, commands, and the jobs of before.

import * as api from "./api.js";
import { byId, copy, counted, decibels, listed, make, timed } from "./dom.js";
import { PLAIN } from "./looks.js";
import { METHODS, STAGES } from "./methods.js";

/** @typedef {import("./track.js").Track} Track */
/** @typedef {import("./history.js").Entry} Entry */
/** @typedef {import("./looks.js").Look} Look */
/** @typedef {{ open: (entry: Entry) => void, forget: (entry: Entry) => void }} HistoryActions */

/** The rows of the table: what they are, and what a track has of it. @type {[string, (track: Track) => string][]} */
const ROWS = [
  ["Method", ({ parameters }) => parameters.method ?? "–"],
  ["Vertices", ({ size }) => (size ? counted(size) : "–")],
  ["Triangles", ({ faceCount, size }) => (size ? counted(faceCount) : "–")],
  ["Share of the pixels", (track) => shareOf(track)],
  ["Likeness (PSNR)", ({ psnr }) => decibels(psnr)],
  ["Largest size", ({ job, stage }) => (stage === "final" && job?.mesh ? counted(job.mesh.vertices ?? 0) : "–")],
  ["Its likeness", ({ job, stage }) => (stage === "final" && job?.mesh ? decibels(job.mesh.psnr_db) : "–")],
  ["Total time", ({ job }) => (job?.timings_ms ? timed(Object.values(job.timings_ms).reduce((sum, ms) => sum + ms, 0)) : "–")],
];

/** Stages in their order, which are shown whether or not a job has had them. */
const USUAL_STAGES = ["queue", "decode", "density", "diffuse", "triangulate", "simplify", "order", "encode"];

/** @param {Track} track */
export function shareOf({ points, size }) {
  return points && size ? `${((100 * size) / (points.width * points.height)).toFixed(2)} %` : "–";
}

/** The table of one or two tracks. @param {Track[]} tracks */
export function showNumbers(tracks) {
  const stages = [...new Set([...USUAL_STAGES, ...tracks.flatMap(({ job }) => Object.keys(job?.timings_ms ?? {}))])];
  /** @type {[string, (track: Track) => string][]} */
  const times = stages.map((stage) => [STAGES[stage] ?? stage, ({ job }) => (job?.timings_ms?.[stage] === undefined ? "–" : timed(job.timings_ms[stage]))]);
  const body = [...ROWS, ...times].map(([name, value]) => {
    return make("tr", {}, make("th", { scope: "row" }, name), ...tracks.map((track) => make("td", {}, value(track))));
  });
  const titles = tracks.length > 1 ? ["A", "B"] : ["Value"];
  const head = make("tr", {}, make("th", { scope: "col" }, "Figure"), ...titles.map((title) => make("th", { scope: "col" }, title)));
  const caption = make("caption", { class: "hidden" }, "Figures of the mesh");
  byId("numbers", HTMLTableElement).replaceChildren(caption, make("thead", {}, head), make("tbody", {}, ...body));
}

/** The table as a spreadsheet takes it. */
export function numbersAsText() {
  const rows = [...byId("numbers", HTMLTableElement).rows];
  return rows.map((row) => [...row.cells].map((cell) => cell.textContent).join("\t")).join("\n");
}

/**
 * The commands that make what is seen.
 * @param {Track} track @param {string} name
 */
export function curlOf(track, name) {
  const key = api.key.get() ? " -H 'Authorization: Bearer KEY'" : "";
  const quoted = name.replaceAll("'", "'\\''");
  const { format: _, keep_image: __, ...parameters } = track.parameters;
  const asked = api.query({ ...parameters, format: "png" });
  const command = `curl -sSf${key} --data-binary @'${quoted}' '${location.origin}/v1/meshes?${asked}' -o mesh.png`;
  const path = track.meshPath("png");
  if (!track.isProgressive || track.size >= track.most || !path) return command;
  return `${command}\n\n# its ${track.size} most important vertices\ncurl -sSf${key} '${location.origin}${path}' -o mesh-${track.size}.png`;
}

/** HTML that shows what is seen. @param {Track} track @param {string} name */
export function embedOf(track, name) {
  const path = track.meshPath("svg", { shading: "gradient" });
  if (!path || !track.points) return "";
  const { width, height } = track.points;
  return `<img src="${location.origin}${path.replaceAll("&", "&amp;")}" width="${width}" height="${height}" alt="${name.replaceAll(/[&"<]/g, "")}">`;
}

/** How long the links of a job work. @param {api.Job | null} job */
export function endOf(job) {
  if (!job?.expires_at) return "Links work for as long as this server keeps the mesh.";
  const hours = Math.max(1, Math.round((Date.parse(job.expires_at) - Date.now()) / 3_600_000));
  return `Links work for about ${hours} h: then this server deletes picture and mesh. Who has the link sees both.`;
}

/** @param {Entry[]} entries @param {string | undefined} current @param {HistoryActions} actions */
export function showHistory(entries, current, actions) {
  const list = byId("history", HTMLUListElement);
  byId("history-note", HTMLParagraphElement).hidden = entries.length > 0;
  listed(list, entries, ({ id }) => id, (entry) => historyItem(entry, actions), (item, entry) => {
    const open = /** @type {HTMLButtonElement} */ (item.firstElementChild);
    if (entry.id === current) open.setAttribute("aria-current", "true");
    else open.removeAttribute("aria-current");
  });
}

/** A job of before, by which it is opened or forgotten. @param {Entry} entry @param {HistoryActions} actions */
function historyItem(entry, actions) {
  const image = make("img", { alt: "" });
  image.addEventListener("load", () => URL.revokeObjectURL(image.src));
  if (entry.thumbnail) image.src = URL.createObjectURL(entry.thumbnail);
  const what = `${METHODS[entry.method]?.title ?? entry.method}, ${counted(entry.vertices)} vertices, ${decibels(entry.psnr)}`;
  const open = make("button", { type: "button", class: "open" }, image, make("span", {}, entry.name), make("span", { class: "what" }, what));
  open.addEventListener("click", () => actions.open(entry));
  const forget = make("button", { type: "button", "aria-label": `Forget ${entry.name}, ${what}` }, "✕");
  forget.addEventListener("click", () => actions.forget(entry));
  return make("li", {}, open, forget);
}

/** Makes the cards of the outcomes. @param {Map<string, import("./presets.js").Preset>} presets @param {(name: string) => void} onChoice */
export function makePresets(presets, onChoice) {
  const cards = [...presets].map(([name, { title, about }]) => {
    const canvas = make("canvas", { width: "112", height: "84", "aria-hidden": "true" });
    const button = make("button", { type: "button", "data-preset": name, "aria-pressed": "false", title: about }, canvas, make("strong", {}, title));
    button.addEventListener("click", () => onChoice(name));
    return button;
  });
  byId("presets", HTMLDivElement).replaceChildren(...cards);
}

/** @param {Map<string, import("./presets.js").Preset>} presets @param {string} chosen  Empty where something else is asked for. @param {string} suited */
export function showPresets(presets, chosen, suited) {
  byId("preset-about", HTMLParagraphElement).textContent = presets.get(chosen)?.about ?? "";
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("#presets button"))) {
    button.setAttribute("aria-pressed", String(button.dataset.preset === chosen));
    button.classList.toggle("suited", button.dataset.preset === suited);
  }
}

/** Shows the outcomes of a picture; without any, those of the picture before are gone. @param {Record<string, ImageBitmap>} images */
export function showThumbnails(images) {
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("#presets button"))) {
    const image = images[button.dataset.preset ?? ""];
    const canvas = button.querySelector("canvas");
    const context = canvas?.getContext("2d");
    if (canvas) context?.clearRect(0, 0, canvas.width, canvas.height);
    if (!image || !canvas) continue;
    context?.drawImage(image, 0, 0, canvas.width, canvas.height);
    image.close();
  }
}

const LOOK_CONTROLS = /** @type {const} */ ({
  shading: "look-shading", edges: "look-edges", edgeColor: "look-edge-color", colors: "look-colors",
  count: "look-count", dark: "look-dark", light: "look-light",
});

/** Makes the controls of the look tell what they say. @param {(look: Look) => void} onLook */
export function bindLook(onLook) {
  /** @param {string} id */
  const control = (id) => /** @type {HTMLInputElement | HTMLSelectElement} */ (document.getElementById(id));
  const ground = byId("look-ground", HTMLInputElement), background = byId("look-background", HTMLInputElement);
  const hear = () => {
    const said = Object.fromEntries(Object.entries(LOOK_CONTROLS).map(([name, id]) => [name, control(id).value]));
    const look = /** @type {Look} */ (/** @type {unknown} */ ({
      ...said, edges: Number(said.edges), count: Number(said.count), background: ground.checked ? background.value : "",
    }));
    // A palette is for faces: between vertices of two of its colours others would come.
    if (look.colors === "palette") look.shading = "flat";
    onLook(look);
  };
  for (const id of [...Object.values(LOOK_CONTROLS), "look-ground", "look-background"]) control(id).addEventListener("input", hear);
  byId("look-reset", HTMLButtonElement).addEventListener("click", () => onLook({ ...PLAIN }));
}

/** Puts the controls as a look is. @param {Look} look */
export function showLook(look) {
  for (const [name, id] of Object.entries(LOOK_CONTROLS)) {
    const control = /** @type {HTMLInputElement | HTMLSelectElement} */ (document.getElementById(id));
    if (document.activeElement !== control || control instanceof HTMLSelectElement) control.value = String(look[/** @type {keyof typeof LOOK_CONTROLS} */ (name)]);
  }
  byId("look-ground", HTMLInputElement).checked = look.background !== "";
  byId("look-background", HTMLInputElement).value = look.background || "#ffffff";
  byId("look-palette", HTMLDivElement).hidden = look.colors !== "palette";
  byId("look-duotone", HTMLDivElement).hidden = look.colors !== "duotone";
  byId("look-count-value", HTMLOutputElement).textContent = String(look.count);
}

/** Makes the button copy the table beside it. */
export function bindCopying() {
  const button = byId("copy-numbers", HTMLButtonElement);
  button.addEventListener("click", () => copy(numbersAsText(), button));
}

/**
 * What goes on.
 * @param {import("./state.js").Machine} machine @param {Track} track
 */
export function showProgress({ phase, sent, isBusy }, { job, isLost }) {
  byId("progress", HTMLDivElement).hidden = !isBusy;
  if (!isBusy) return;
  const isSending = phase === "uploading";
  const stage = job?.progress?.stage ?? (job?.state === "running" ? "decode" : "queue");
  const fraction = isSending ? (sent > 0 ? sent : undefined) : job?.progress?.overall_fraction;
  const rest = isSending ? 0 : job?.progress?.remaining_s;
  const name = isSending ? (sent < 1 ? "Sending the picture" : "Sent: waiting for the server") : STAGES[stage] ?? stage;
  byId("progress-stage", HTMLSpanElement).textContent = isLost ? "Connection lost – reconnecting…" : name;
  byId("progress-percent", HTMLSpanElement).textContent = fraction === undefined || isLost ? "" : `${Math.round(100 * fraction)} %${rest ? `, about ${rest} s left` : ""}`;
  const bar = byId("progress-bar", HTMLProgressElement);
  if (fraction === undefined) bar.removeAttribute("value");
  else bar.value = fraction;
}
