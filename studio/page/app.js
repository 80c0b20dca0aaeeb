// The studio: a picture goes to the service, and its mesh is seen in every size.
//
// A track has a job of the service and computes what is seen of its mesh in a worker; the stage
// draws; the form says what is asked for. The second track is the method compared with.

import { addressOf, showAsked } from "./address.js";
import * as api from "./api.js";
import { Curve } from "./curve.js";
import { byId, counted, decibels, sized } from "./dom.js";
import { Form } from "./form.js";
import { readGlb } from "./glb.js";
import * as history from "./history.js";
import { TARGETS } from "./methods.js";
import * as panels from "./panels.js";
import { bitmapOf, decoded, fromService, samplesOf } from "./picture.js";
import { SAMPLES } from "./samples.js";
import { bindSettings } from "./settings.js";
import { Stage } from "./stage.js";
import { Track } from "./track.js";

/** @typedef {import("./picture.js").Picture} Picture */
/** @typedef {import("./renderer.js").Bitmap} Bitmap */
/** The picture that is meshed. @typedef {{ name: string, file: Blob, sample: string | null, bitmap: Bitmap | null, picture: Picture | null, isFinding: boolean }} Source */

const SAMPLE_SIDES = { width: 640, height: 480 };
const GROWTH_MS = 2600;
const SETTLED_MS = 160;

export class Studio {
  constructor() {
    /** @type {Source | null} */
    this.source = null;
    /** Whether the sizes have been touched: then nothing moves by itself. */
    this.isTouched = false;
    this.settling = 0;
    this.growing = 0;
    this.wantedSize = 0;
    /** What an address asked to be in the middle, and how large. @type {number[]} */
    this.askedView = [];
    this.asksRelief = false;
    this.stage = new Stage({
      onDensity: () => this.orderDensity(),
      onRelief: () => this.showRelief(),
      onRestored: () => this.restore(),
      onSeen: () => this.settle(),
      onSize: (factor) => this.setSize(Math.max(this.tracks[0].size * factor, this.tracks[0].size + Math.sign(factor - 1))),
    });
    this.tracks = [0, 1].map((side) => new Track(side, (track, word) => this.hear(track, word)));
    this.curve = new Curve((size) => this.setSize(size));
    /** @type {Form | null} */
    this.form = null;
    /** @type {string[]} */
    this.formats = [];
  }

  /** The tracks that are seen. */
  get seen() {
    return this.form?.comparedMethod ? this.tracks : this.tracks.slice(0, 1);
  }

  async begin() {
    const asked = new URLSearchParams(location.search);
    if (asked.get("dir") === "rtl") document.documentElement.dir = "rtl";
    this.bindPage();
    this.bindPictures();
    this.showAll();
    const methods = await api.methods();
    this.formats = [...new Set(methods.formats.map(({ format }) => format))];
    this.form = new Form(byId("form", HTMLFormElement), methods, () => this.run());
    this.form.fill(asked);
    showAsked(asked, this.stage);
    this.askedView = (asked.get("view") ?? "").split(" ").map(Number);
    this.asksRelief = asked.get("relief") === "1";
    this.wantedSize = Number(asked.get("n")) || 0;
    this.isTouched = this.wantedSize > 0;
    await this.listHistory();
    await this.openFirst(asked);
  }

  /** @param {URLSearchParams} asked */
  async openFirst(asked) {
    const id = asked.get("job");
    if (id) {
      const known = await history.entry(id).catch(() => undefined);
      await this.openJob(id, known);
      return;
    }
    const name = asked.get("sample") ?? "lake";
    await this.chooseSample(name in SAMPLES ? name : "lake");
  }

  // Pictures.

  bindPictures() {
    const input = byId("file", HTMLInputElement);
    input.addEventListener("change", () => {
      const file = input.files?.[0];
      if (file) this.choose(file, file.name);
      input.value = "";
    });
    const box = byId("stage-box", HTMLDivElement), hint = byId("drop-hint", HTMLParagraphElement);
    /** @param {boolean} isOver */
    const mark = (isOver) => {
      hint.hidden = !isOver;
      box.classList.toggle("dropping", isOver);
    };
    document.addEventListener("dragover", (event) => {
      event.preventDefault();
      mark(true);
    });
    document.addEventListener("dragleave", (event) => event.relatedTarget === null && mark(false));
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      mark(false);
      const file = event.dataTransfer?.files[0];
      if (file) this.choose(file, file.name);
    });
    document.addEventListener("paste", (event) => {
      const file = event.clipboardData?.files[0];
      if (file) this.choose(file, file.name || "pasted.png");
    });
    this.painter = new Worker(new URL("sample-worker.js", import.meta.url), { type: "module" });
    /** @type {Map<string, (blob: Blob) => void>} */
    this.painting = new Map();
    this.painter.onmessage = ({ data: { name, width, blob } }) => this.painting?.get(`${name} ${width}`)?.(blob);
    for (const button of document.querySelectorAll("#samples button")) {
      const name = /** @type {HTMLElement} */ (button).dataset.sample ?? "";
      button.addEventListener("click", () => this.chooseSample(name));
    }
  }

  /** Paints one of our pictures. @param {string} name @param {number} width @param {number} height @returns {Promise<Blob>} */
  painted(name, width, height) {
    this.painter?.postMessage({ name, width, height });
    return new Promise((resolve) => this.painting?.set(`${name} ${width}`, resolve));
  }

  async paintThumbnails() {
    for (const image of document.querySelectorAll("#samples img")) {
      const name = image.parentElement?.dataset.sample ?? "";
      /** @type {HTMLImageElement} */ (image).src = URL.createObjectURL(await this.painted(name, 120, 90));
    }
  }

  /** @param {string} name */
  async chooseSample(name) {
    const file = await this.painted(name, SAMPLE_SIDES.width, SAMPLE_SIDES.height);
    await this.choose(file, `${name}.png`, name);
  }

  /** Begins with a picture. @param {Blob} file @param {string} name @param {string | null} [sample] */
  async choose(file, name, sample = null) {
    this.endGrowth();
    await this.setSource(file, name, sample);
    await this.run();
  }

  /** @param {Blob} file @param {string} name @param {string | null} sample */
  async setSource(file, name, sample) {
    this.fail(null);
    this.tracks.forEach((track) => {
      track.cancel().catch(() => {});
      track.clear();
    });
    const bitmap = await decoded(file);
    this.source = { name, file, sample, bitmap, picture: null, isFinding: false };
    for (const button of document.querySelectorAll("#samples button")) {
      button.setAttribute("aria-pressed", String(/** @type {HTMLElement} */ (button).dataset.sample === sample));
    }
    byId("picture-note", HTMLParagraphElement).textContent = bitmap
      ? `${name}, ${counted(bitmap.width)} × ${counted(bitmap.height)} pixels.`
      : `${name}: this browser cannot show it; the service may know the format.`;
    if (bitmap) this.showBitmap(bitmap);
  }

  /** @param {Bitmap} bitmap */
  showBitmap(bitmap) {
    const { renderer, view, scene } = this.stage;
    if (Math.max(bitmap.width, bitmap.height) > renderer.maxSide) {
      throw new Error(`This browser's graphics draw pictures of up to ${renderer.maxSide} pixels a side. Make the picture smaller and try again.`);
    }
    const isOther = bitmap.width !== renderer.width || bitmap.height !== renderer.height;
    renderer.setOriginal(bitmap);
    const [x, y, zoom] = this.askedView;
    if (zoom > 0) {
      Object.assign(scene, { x, y });
      view.zoomTo(zoom);
      this.askedView = [];
    } else if (isOther) view.fit();
    this.stage.redraw();
  }

  /** Has the original's samples as the service reads them, so that figures are the service's. @param {import("./api.js").Job} job */
  async findPicture(job) {
    const { source } = this;
    if (!source || source.picture || source.isFinding || !job.image) return;
    source.isFinding = true;
    const shape = /** @type {Required<NonNullable<typeof job.image>>} */ (job.image);
    let picture = source.bitmap && samplesOf(source.bitmap, shape);
    if (!picture) {
      picture = await fromService(source.file, this.tracks[0].reading(), this.tracks[0].aborter.signal).catch(() => null);
      if (!picture || source !== this.source) return;
      source.bitmap = bitmapOf(picture);
      this.showBitmap(source.bitmap);
      this.restoreMeshes();
    }
    source.picture = picture;
    if (this.stage.scene.layer === "density") this.orderDensity();
  }

  orderDensity() {
    const picture = this.source?.picture;
    if (picture) this.tracks[0].order({ kind: "density", picture });
  }

  // Jobs.

  async run() {
    const { source, form } = this;
    if (!source || !form) return;
    this.fail(null);
    [source.picture, source.isFinding] = [null, false];
    const parameters = form.parameters();
    const isCompared = form.comparedMethod !== "";
    this.stage.setPanes(isCompared ? 2 : 1);
    if (!isCompared) this.tracks[1].cancel().catch(() => {}).finally(() => this.tracks[1].clear());
    const other = isCompared ? this.tracks[1].run(source.file, { ...parameters, method: form.comparedMethod }, false) : null;
    await Promise.all([this.tracks[0].run(source.file, parameters, true), other]);
  }

  /** Shows a job of before. @param {string} id @param {history.Entry} [known] */
  async openJob(id, known) {
    this.endGrowth();
    this.isTouched = true;
    if (known) await this.setSource(known.file, known.name, null);
    else this.source = { name: "picture", file: new Blob(), sample: null, bitmap: null, picture: null, isFinding: true };
    await this.tracks[0].open(id);
    const asked = Object.entries(this.tracks[0].parameters).filter(([name]) => name === "method" || name in TARGETS);
    this.form?.fill(new URLSearchParams(asked));
  }

  /** @param {Track} track @param {import("./track.js").Word} word */
  hear(track, word) {
    const { renderer } = this.stage;
    switch (word.kind) {
      case "job":
        this.onJob(track);
        break;
      case "points":
        this.onPoints(track);
        break;
      case "mesh":
        if (track.points) renderer.setMesh(track.side, word.geometry, track.points.precision);
        this.stage.redraw();
        break;
      case "density":
        renderer.setDensity(word.map);
        this.stage.redraw();
        return;
      case "failure":
        this.fail(word.error);
    }
    this.showAll();
  }

  /** @param {Track} track */
  onJob(track) {
    const { job } = track;
    if (!job) return;
    if (track.side === 0) this.findPicture(job);
    if (job.state === "failed") {
      const reason = /** @type {{ detail?: string } | null} */ (job.error);
      this.fail(new Error(`The job failed: ${reason?.detail ?? "the service gives no reason"}. Change what is asked for and run it again.`));
    }
    if (job.state === "cancelled") this.say("Cancelled.");
    if (job.state === "completed" && track.stage === "final") this.onCompleted(track);
  }

  /** @param {Track} track */
  onCompleted(track) {
    this.say(`The mesh is there: ${counted(track.most)} vertices, ${decibels(track.job?.mesh?.psnr_db)}.`);
    const { source } = this;
    if (track.side === 0 && source?.file.size && track.job) this.remember(track, source).catch(() => {});
    if (track.side === 0 && this.asksRelief) {
      this.asksRelief = false;
      this.stage.setRelief(true);
    }
  }

  /** @param {Track} track */
  onPoints(track) {
    const { points } = track;
    const { renderer, view } = this.stage;
    if (!points) return;
    if (points.width !== renderer.width || points.height !== renderer.height) {
      renderer.setSize(points.width, points.height);
      view.fit();
    }
    if (!track.isProgressive) return;
    if (track.side === 1) {
      track.show(this.wantedSize || this.tracks[0].size || track.most);
    } else if (!this.isTouched && this.mayMove()) {
      this.grow();
    } else {
      this.setSize(this.wantedSize || track.most);
      this.wantedSize = 0;
    }
  }

  /** @param {Track} track @param {Source} source */
  async remember(track, source) {
    const { job } = track;
    if (!job) return;
    await history.remember({
      id: job.id, at: Date.parse(job.created_at), name: source.name, file: source.file,
      thumbnail: await history.thumbnailOf(source.file), method: track.parameters.method ?? "mgprfs",
      vertices: job.mesh?.vertices ?? 0, psnr: job.mesh?.psnr_db ?? null,
    });
    await this.listHistory();
  }

  async listHistory() {
    const entries = await history.entries().catch(() => []);
    panels.showHistory(entries, this.tracks[0].job?.id, {
      open: (entry) => this.openJob(entry.id, entry).catch((error) => this.fail(error)),
      forget: async ({ id }) => {
        await history.forget(id);
        await this.listHistory();
      },
    });
  }

  // Sizes.

  /** @param {number} size */
  setSize(size) {
    this.isTouched = true;
    this.endGrowth();
    this.showSize(Math.round(size));
  }

  /** @param {number} size */
  showSize(size) {
    for (const track of this.seen) if (track.isProgressive) track.show(size);
    this.showFigures();
    this.settle();
  }

  mayMove() {
    return !matchMedia("(prefers-reduced-motion: reduce)").matches && this.stage.scene.layer === "mesh";
  }

  /** Lets the first mesh grow from its corners, once: that is what this page is about. */
  grow() {
    this.isTouched = true;
    const began = performance.now();
    const frame = () => {
      const t = Math.min(1, (performance.now() - began) / GROWTH_MS);
      this.stage.toggle("wireframe", t < 0.9);
      this.showSize(this.curve.sizeAt(0.18 + 0.82 * (1 - (1 - t) ** 1.6)));
      this.growing = t < 1 ? requestAnimationFrame(frame) : 0;
    };
    this.growing = requestAnimationFrame(frame);
  }

  endGrowth() {
    if (!this.growing) return;
    cancelAnimationFrame(this.growing);
    this.growing = 0;
    this.stage.toggle("wireframe", false);
  }

  // What is shown beside the picture.

  showAll() {
    this.showFigures();
    panels.showProgress(this.tracks.find((track) => track.isWorking) ?? this.tracks[0]);
    panels.showNumbers(this.seen);
    this.settle();
  }

  showFigures() {
    const [track] = this.tracks;
    /** @param {string} id @param {string} text */
    const put = (id, text) => (byId(id, HTMLElement).textContent = text);
    put("figure-vertices", track.size ? counted(track.size) : "–");
    put("figure-psnr", decibels(track.psnr));
    put("figure-faces", track.faceCount ? counted(track.faceCount) : "–");
    put("figure-share", panels.shareOf(track));
    const isWhole = track.stage === "final" && track.size > 0;
    put("figure-bytes", isWhole ? `≈ ${sized(this.bytesOf(track))}` : "–");
    put("size-note", this.noteOf(track));
    this.curve.update(this.seen);
    const label = track.size ? `${this.source?.name ?? "Picture"} as a mesh of ${counted(track.size)} vertices, PSNR ${decibels(track.psnr)}` : "No mesh yet";
    this.stage.canvas.setAttribute("aria-label", label);
    this.showLabels();
  }

  /** About the bytes of a pmesh of the size that is seen. @param {Track} track */
  bytesOf({ points, size }) {
    if (!points) return 0;
    const bits = Math.log2((Math.E * points.width * points.height) / size) + 0.62 * points.precision * points.components;
    return Math.round(24 + (size * bits) / 8);
  }

  /** @param {Track} track */
  noteOf(track) {
    if (track.stage === "preview") return "A preview; the real mesh is on its way.";
    if (track.stage === "final" && !track.isProgressive) return "This method makes one size: run it again for another.";
    return "Drag, and every size is there at once.";
  }

  showLabels() {
    const [a, b] = this.tracks;
    const isCompared = this.seen.length > 1, isSplit = this.stage.scene.split !== null && !isCompared;
    const first = byId("label-a", HTMLParagraphElement), second = byId("label-b", HTMLParagraphElement);
    first.hidden = second.hidden = !(isCompared || isSplit);
    first.textContent = isCompared ? `A: ${a.parameters.method ?? ""}, ${decibels(a.psnr)}` : "original";
    second.textContent = isCompared ? `B: ${b.parameters.method ?? ""}, ${decibels(b.psnr)}` : "mesh";
  }

  /** What takes a moment waits until the hand rests. */
  settle() {
    clearTimeout(this.settling);
    this.settling = setTimeout(() => this.onSettled(), SETTLED_MS);
  }

  onSettled() {
    const [track] = this.tracks;
    panels.showNumbers(this.seen);
    this.showLabels();
    if (this.growing) return;
    panels.showDownloads(track, this.formats, this.source?.name ?? "mesh", (error) => this.fail(error));
    byId("curl", HTMLPreElement).textContent = panels.curlOf(track, this.source?.name ?? "picture.png");
    const address = addressOf(this);
    byId("address", HTMLPreElement).textContent = address;
    if (track.stage === "final") globalThis.history.replaceState(null, "", address);
    this.measureBytes(track).catch(() => {});
  }

  /** Asks the service how many bytes the mesh that is seen takes. @param {Track} track */
  async measureBytes(track) {
    if (track.stage !== "final" || !track.points || track.points.faces) return;
    const path = panels.meshPathOf(track, "pmesh"), { size } = track;
    const length = Number((await api.request(path, { method: "HEAD" })).headers.get("content-length"));
    if (length && size === this.tracks[0].size) byId("figure-bytes", HTMLElement).textContent = sized(length);
  }

  /** Fetches the mesh as GLB and shows it in three dimensions. */
  async showRelief() {
    const [track] = this.tracks;
    try {
      if (track.stage !== "final") throw new Error("There is no mesh yet. Wait for it, or make one.");
      /** @type {api.Parameters} */
      const relief = track.job?.parameters?.relief ? {} : { relief: "luma" };
      const path = panels.meshPathOf(track, "glb", {
        ...relief, compression: "none", texture: "none", color: "image", center: "false", up: "z",
      });
      const response = await api.request(path);
      this.stage.renderer.relief?.set(readGlb(await response.arrayBuffer()));
      this.stage.redraw();
    } catch (error) {
      this.stage.setRelief(false);
      this.fail(/** @type {Error} */ (error));
    }
  }

  /** Draws everything anew after the graphics card has lost it. */
  restore() {
    const bitmap = this.source?.bitmap;
    if (bitmap) this.stage.renderer.setOriginal(bitmap);
    this.restoreMeshes();
  }

  restoreMeshes() {
    for (const track of this.tracks) if (track.size) track.order({ kind: "show", size: track.size });
  }

  // The page.

  bindPage() {
    panels.bindCopying();
    byId("cancel-button", HTMLButtonElement).addEventListener("click", () => {
      for (const track of this.tracks) track.cancel().catch((error) => this.fail(error));
      this.stage.canvas.focus();
    });
    byId("failure-close", HTMLButtonElement).addEventListener("click", () => this.fail(null));
    bindSettings();
  }

  /** Says what went wrong, or takes it back. @param {Error | null} error */
  fail(error) {
    byId("failure", HTMLParagraphElement).hidden = error === null;
    byId("failure-text", HTMLSpanElement).textContent = error?.message ?? "";
    panels.showProgress(this.tracks.find((track) => track.isWorking) ?? this.tracks[0]);
  }

  /** Tells those who do not see it. @param {string} text */
  say(text) {
    byId("status", HTMLParagraphElement).textContent = text;
  }
}

/** @param {unknown} reason */
function report(reason) {
  const text = reason instanceof Error ? reason.message : String(reason);
  byId("failure", HTMLParagraphElement).hidden = false;
  byId("failure-text", HTMLSpanElement).textContent = text;
}

addEventListener("unhandledrejection", ({ reason }) => report(reason));

/** The page's one studio; null where the browser cannot draw. @type {Studio | null} */
export let studio = null;
try {
  studio = new Studio();
  studio.begin().catch(report).finally(() => studio?.paintThumbnails());
} catch (error) {
  report(error);
}
