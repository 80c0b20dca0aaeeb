// One mesh in the making and then all its sizes: a job of the service, and a worker that computes
// what is seen of it.

import * as api from "./api.js";
import { psnrOf } from "./pmesh.js";
import { ServiceError } from "./problems.js";

/** @typedef {import("./api.js").Job} Job */
/** @typedef {import("./api.js").Parameters} Parameters */
/** @typedef {import("./pmesh.js").Points} Points */
/** @typedef {import("./picture.js").Picture} Picture */
/**
 * What is heard of a track: its job has changed, there are other points, the mesh of a size is
 * there, the density is.
 * @typedef {{ kind: "job" } | { kind: "points" } | { kind: "density", map: Uint8Array }
 *   | { kind: "mesh", geometry: import("./geometry.js").Geometry }
 *   | { kind: "failure", error: Error }} Word
 */

/** Sizes of the curve, at the most. */
const CURVE_POINTS = 160;

export class Track {
  /** @param {number} side @param {(track: Track, word: Word) => void} hear */
  constructor(side, hear) {
    this.side = side;
    this.hear = hear;
    /** @type {Parameters} */
    this.parameters = {};
    /** @type {Job | null} */
    this.job = null;
    /** Whether the connection to the service is lost while the job goes on. */
    this.isLost = false;
    /** @type {"none" | "preview" | "final"} */
    this.stage = "none";
    /** @type {Points | null} */
    this.points = null;
    /** The size seen, and its PSNR as far as it is known. */
    this.size = 0;
    /** @type {number | null | undefined} */
    this.psnr = undefined;
    this.faceCount = 0;
    /** PSNR by size. @type {Map<number, number>} */
    this.curve = new Map();
    this.aborter = new AbortController();
    this.generation = 0;
    this.worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
    this.worker.onmessage = ({ data }) => this.receive(data);
  }

  /** The largest size. */
  get most() {
    return this.points?.xs.length ?? 0;
  }

  /** Whether every smaller size is there too. */
  get isProgressive() {
    return this.stage === "final" && Boolean(this.points?.ranks);
  }

  get isWorking() {
    return this.job !== null && !api.isFinal(this.job.state);
  }

  /** Ends what goes on, here and at the service. */
  async cancel() {
    this.aborter.abort();
    const { job, isWorking } = this;
    if (!job || !isWorking) return;
    this.job = { ...job, state: "cancelled", progress: null };
    this.hear(this, { kind: "job" });
    await api.cancel(job.id);
  }

  /** Forgets everything but the worker. */
  clear() {
    this.aborter.abort();
    [this.job, this.stage, this.points, this.isLost] = [null, "none", null, false];
    [this.size, this.psnr] = [0, undefined];
    this.curve.clear();
  }

  /**
   * Meshes a picture.
   * @param {Blob} file @param {Parameters} parameters @param {boolean} withPreview
   */
  async run(file, parameters, withPreview) {
    if (this.isWorking) this.cancel().catch(() => {});
    this.clear();
    const aborter = (this.aborter = new AbortController());
    this.parameters = parameters;
    const { signal } = aborter;
    await this.guarded(signal, async () => {
      // What is wrong with the picture or the parameters, the job will say.
      if (withPreview) await this.preview(file, signal).catch(() => {});
      if (signal.aborted) return;
      this.job = await this.submit(file, signal);
      this.hear(this, { kind: "job" });
      await this.followToEnd(this.job.id, signal);
    });
  }

  /** Takes up a job that was submitted before. @param {string} id */
  async open(id) {
    if (this.isWorking) this.cancel().catch(() => {});
    this.clear();
    const { signal } = (this.aborter = new AbortController());
    await this.guarded(signal, async () => {
      this.job = await api.job(id, signal);
      this.parameters = asTexts(this.job.parameters ?? {});
      this.hear(this, { kind: "job" });
      if (api.isFinal(this.job.state)) await this.finish(signal);
      else await this.followToEnd(id, signal);
    });
  }

  /** @param {AbortSignal} signal @param {() => Promise<void>} work */
  async guarded(signal, work) {
    try {
      await work();
    } catch (error) {
      if (signal.aborted) return;
      this.hear(this, { kind: "failure", error: /** @type {Error} */ (error) });
    }
  }

  /** Submits a job that keeps every size, where its method can. @param {Blob} file @param {AbortSignal} signal */
  async submit(file, signal) {
    try {
      return await api.submit(file, { ...this.parameters, format: "progression" }, signal);
    } catch (error) {
      if (!(error instanceof ServiceError) || error.slug !== "format-not-possible") throw error;
      return api.submit(file, this.parameters, signal);
    }
  }

  /** @param {Blob} file @param {AbortSignal} signal */
  async preview(file, signal) {
    const target = ["density", "size"].find((name) => this.parameters[name]);
    const reading = this.reading();
    const { points, psnr } = await api.preview(file, target ? { ...reading, [target]: this.parameters[target] } : reading, signal);
    this.stage = "preview";
    this.psnr = psnr;
    this.setPoints(points);
  }

  /** The parameters by which the picture is read. @returns {Parameters} */
  reading() {
    return Object.fromEntries(Object.entries(this.parameters).filter(([name]) => name === "alpha" || name === "lenient"));
  }

  /** @param {string} id @param {AbortSignal} signal */
  async followToEnd(id, signal) {
    /** @param {boolean} isLost */
    const onConnection = (isLost) => {
      if (isLost === this.isLost) return;
      this.isLost = isLost;
      this.hear(this, { kind: "job" });
    };
    for await (const { state, attempt, progress } of api.follow(id, signal, onConnection)) {
      if (this.job) this.job = { ...this.job, state, attempt, progress };
      this.hear(this, { kind: "job" });
    }
    this.job = await api.job(id, signal);
    await this.finish(signal);
  }

  /** @param {AbortSignal} signal */
  async finish(signal) {
    const { job } = this;
    if (!job) return;
    if (job.state === "completed") {
      const points = await api.mesh(job.id, signal);
      this.stage = "final";
      this.psnr = job.mesh?.psnr_db;
      this.setPoints(points);
    }
    this.hear(this, { kind: "job" });
  }

  /** @param {Points} points */
  setPoints(points) {
    this.points = points;
    this.generation++;
    this.curve = this.isProgressive ? this.wholeCurve(points) : new Map();
    this.order({ kind: "points", points });
    this.size = 0;
    this.show(points.xs.length);
    this.hear(this, { kind: "points" });
  }

  /** PSNR at sizes from the corners to all, evenly by their logarithm. @param {Points} points */
  wholeCurve(points) {
    /** @type {Map<number, number>} */
    const curve = new Map();
    for (let i = 0; i <= CURVE_POINTS; i++) {
      const size = Math.round(4 * (this.most / 4) ** (i / CURVE_POINTS));
      curve.set(size, psnrOf(points, size));
    }
    return curve;
  }

  /** Has the mesh of a size drawn. @param {number} size */
  show(size) {
    const shown = this.isProgressive ? Math.min(Math.max(size, 4), this.most) : this.most;
    if (shown === this.size || !this.points) return;
    this.size = shown;
    if (this.isProgressive) this.psnr = psnrOf(this.points, shown);
    this.order({ kind: "show", size: shown });
  }

  /** @param {import("./worker.js").Order} order */
  order(order) {
    this.worker.postMessage(order);
  }

  /** @param {import("./worker.js").News} news */
  receive(news) {
    if (news.kind === "density") {
      this.hear(this, news);
    } else if (news.generation === this.generation) {
      this.faceCount = news.geometry.faceCount;
      this.hear(this, news);
    }
  }
}

/** @param {Record<string, unknown>} values @returns {Parameters} */
function asTexts(values) {
  return Object.fromEntries(Object.entries(values).map(([name, value]) => [name, String(value)]));
}
