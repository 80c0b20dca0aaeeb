// What can be taken from the page: numbers, files, commands, and the jobs of before.

import * as api from "./api.js";
import { byId, copy, counted, decibels, listed, make, timed } from "./dom.js";
import { FORMATS, STAGES } from "./methods.js";

/** @typedef {import("./track.js").Track} Track */
/** @typedef {import("./history.js").Entry} Entry */
/** @typedef {{ open: (entry: Entry) => void, forget: (entry: Entry) => void }} HistoryActions */

/** The rows of the table: what they are, and what a track has of it. @type {[string, (track: Track) => string][]} */
const ROWS = [
  ["Method", ({ parameters }) => parameters.method ?? "mgprfs"],
  ["Vertices", ({ size }) => (size ? counted(size) : "–")],
  ["Triangles", ({ faceCount, size }) => (size ? counted(faceCount) : "–")],
  ["Of the pixels", (track) => shareOf(track)],
  ["PSNR", ({ psnr }) => decibels(psnr)],
  ["Largest size", ({ job, stage }) => (stage === "final" && job?.mesh ? counted(job.mesh.vertices ?? 0) : "–")],
  ["its PSNR", ({ job, stage }) => (stage === "final" && job?.mesh ? decibels(job.mesh.psnr_db) : "–")],
  ["Time in all", ({ job }) => (job?.timings_ms ? timed(Object.values(job.timings_ms).reduce((sum, ms) => sum + ms, 0)) : "–")],
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
 * Links to the mesh that is seen, in every format.
 * @param {Track} track @param {string[]} formats @param {string} name @param {(error: Error) => void} onFailure
 */
export function showDownloads(track, formats, name, onFailure) {
  const { job, stage } = track;
  const list = byId("downloads", HTMLUListElement);
  const isThere = stage === "final" && job !== null;
  byId("download-note", HTMLParagraphElement).hidden = isThere;
  listed(list, isThere ? formats : [], String, (format) => downloadOf(format, onFailure), (item, format) => {
    const link = /** @type {HTMLAnchorElement} */ (item.firstElementChild);
    const path = meshPathOf(track, format);
    if (link.getAttribute("href") !== path) link.href = path;
    link.download = `${name.replace(/\.\w+$/, "")}-${track.size}.${format === "progression" ? "pmesh" : format}`;
  });
}

/** The link to one format, which leads nowhere yet. @param {string} format @param {(error: Error) => void} onFailure */
function downloadOf(format, onFailure) {
  const link = make("a", { title: FORMATS[format] ?? format, "data-format": format }, format);
  // A link would carry no key, and the file would have the service's name instead of the picture's.
  link.addEventListener("click", (event) => {
    event.preventDefault();
    save(link.getAttribute("href") ?? "", link.download).catch(onFailure);
  });
  return make("li", {}, link);
}

/**
 * Where the mesh that is seen is.
 * @param {Track} track @param {string} format @param {api.Parameters} [writing]  How it is written.
 */
export function meshPathOf({ job, size, most }, format, writing = {}) {
  /** @type {api.Parameters} */
  const parameters = { ...(size < most ? { size: String(size) } : {}), format, ...writing };
  return api.meshPath(job?.id ?? "", parameters);
}

/** @param {string} path @param {string} file */
async function save(path, file) {
  const url = URL.createObjectURL(await (await api.request(path)).blob());
  make("a", { href: url, download: file }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

/**
 * The commands that make what is seen.
 * @param {Track} track @param {string} name
 */
export function curlOf(track, name) {
  const key = api.key.get() ? " -H 'Authorization: Bearer KEY'" : "";
  const quoted = name.replaceAll("'", "'\\''");
  const asked = api.query({ ...track.parameters, format: "png" });
  const make = `curl -sSf${key} --data-binary @'${quoted}' '${location.origin}/v1/meshes?${asked}' -o mesh.png`;
  if (!track.isProgressive || track.size >= track.most || !track.job) return make;
  return `${make}\n\n# the ${track.size} vertices that matter most of it\ncurl -sSf${key} '${location.origin}${meshPathOf(track, "png")}' -o mesh-${track.size}.png`;
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
  const what = `${entry.method}, ${counted(entry.vertices)} vertices, ${decibels(entry.psnr)}`;
  const open = make("button", { type: "button", class: "open" }, image, make("span", {}, entry.name), make("span", { class: "what" }, what));
  open.addEventListener("click", () => actions.open(entry));
  const forget = make("button", { type: "button", "aria-label": `Forget ${entry.name}, ${what}` }, "✕");
  forget.addEventListener("click", () => actions.forget(entry));
  return make("li", {}, open, forget);
}

/** Makes the buttons copy what stands beside them. */
export function bindCopying() {
  /** @type {[string, () => string][]} */
  const sources = [
    ["copy-numbers", numbersAsText],
    ["copy-address", () => byId("address", HTMLPreElement).textContent ?? ""],
    ["copy-curl", () => byId("curl", HTMLPreElement).textContent ?? ""],
  ];
  for (const [id, text] of sources) {
    const button = byId(id, HTMLButtonElement);
    button.addEventListener("click", () => copy(text(), button));
  }
}

/**
 * How far a job is.
 * @param {Track} track
 */
export function showProgress(track) {
  const { job, isLost } = track;
  const box = byId("progress", HTMLDivElement);
  box.hidden = !track.isWorking;
  if (!job || box.hidden) return;
  const stage = job.progress?.stage ?? (job.state === "queued" ? "queue" : "decode");
  const fraction = job.progress?.overall_fraction, rest = job.progress?.remaining_s;
  const name = STAGES[stage] ?? stage;
  byId("progress-stage", HTMLSpanElement).textContent = isLost ? "The service is away: waiting for it to come back" : name;
  byId("progress-percent", HTMLSpanElement).textContent = fraction === undefined || isLost ? "" : `${Math.round(100 * fraction)} %${rest ? `, about ${rest} s left` : ""}`;
  const bar = byId("progress-bar", HTMLProgressElement);
  if (fraction === undefined) bar.removeAttribute("value");
  else bar.value = fraction;
  const shown = USUAL_STAGES.includes(stage) ? USUAL_STAGES : [...USUAL_STAGES.slice(0, -1), stage, "encode"];
  byId("progress-stages", HTMLOListElement).replaceChildren(
    ...shown.map((known) => make("li", known === stage ? { "aria-current": "step" } : {}, STAGES[known] ?? known)),
  );
}
