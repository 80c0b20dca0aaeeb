// One mesh in the making and then all its sizes: a job of the service, and a worker that computes
// what is seen of it.

import * as api from "./api.js";
import { PLAIN } from "./looks.js";
import { psnrOf } from "./pmesh.js";
import { ServiceError } from "./problems.js";

/** @typedef {import("./api.js").Job} Job */
/** @typedef {import("./api.js").Parameters} Parameters */
/** @typedef {import("./geometry.js").Geometry} Geometry */
/** @typedef {import("./pmesh.js").Points} Points */
/** @typedef {import("./source.js").Source} Source */
/** @typedef {import("./state.js").Token} Token */
/**
 * What has changed: the job, the points, the mesh that is drawn, the density.
 * @typedef {{ kind: "job" } | { kind: "points" } | { kind: "density", map: Uint8Array }
 *   | { kind: "mesh", geometry: Geometry }} Change
 */

/** Sizes of the curve, at the most. */
const CURVE_POINTS = 160;

/** Problems after which the picture must be sent again. */
const WITHOUT_IMAGE = ["not-found", "gone", "job-without-image"];

export class Track {
  /** @param {number} side @param {(track: Track, change: Change) => void} onChange */
  constructor(side, onChange) {
    this.side = side;
    this.onChange = onChange;
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
    this.generation = 0;
    /** @type {Map<number, (geometry: Geometry) => void>} */
    this.stills = new Map();
    /** Begun when it is needed: the second track seldom is. @type {Worker | null} */
    this.worker = null;
    /** @type {import("./looks.js").Look} */
    this.look = PLAIN;
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

  /** Cancels the job at the service, if it runs. */
  async cancel() {
    const { job, isWorking } = this;
    if (!job || !isWorking) return;
    this.job = { ...job, state: "cancelled", progress: null };
    await api.cancel(job.id).catch(() => {});
  }

  /** Forgets everything but the worker. */
  clear() {
    [this.job, this.stage, this.points, this.isLost] = [null, "none", null, false];
    [this.size, this.psnr, this.faceCount] = [0, undefined, 0];
    this.generation++;
    if (this.worker) this.order({ kind: "points", points: null, generation: this.generation });
    this.curve.clear();
  }

  /**
   * Submits a job for a picture, and cancels the job before.
   * @param {Source} source @param {Parameters} parameters  With a format that keeps every size, where it can.
   * @param {Token} token @param {(sent: number) => void} onSent
   */
  async submit(source, parameters, { signal }, onSent) {
    const former = this.isWorking ? this.job : null;
    this.clear();
    this.parameters = parameters;
    try {
      this.job = await this.submitted(source, parameters, signal, onSent);
      // The picture of a run that was cut short is the service's too.
      source.job = this.job.id;
    } finally {
      if (former) api.cancel(former.id).catch(() => {});
    }
    this.onChange(this, { kind: "job" });
  }

  /** @param {Source} source @param {Parameters} parameters @param {AbortSignal} signal @param {(sent: number) => void} onSent */
  async submitted(source, parameters, signal, onSent) {
    try {
      return await api.submit(source, parameters, signal, onSent);
    } catch (error) {
      if (!(error instanceof ServiceError) || !source.job || !source.file || !WITHOUT_IMAGE.includes(error.slug)) throw error;
      source.job = null;
      return api.submit(source, parameters, signal, onSent);
    }
  }

  /** Shows a mesh that is there without a job. @param {Points} points */
  present(points) {
    this.clear();
    this.stage = "final";
    this.setPoints(points);
  }

  /** Takes up a job that was submitted before. @param {string} id @param {Token} token */
  async open(id, token) {
    const former = this.isWorking ? this.job : null;
    if (former) api.cancel(former.id).catch(() => {});
    this.clear();
    this.job = await api.job(id, token.signal);
    this.parameters = asTexts(this.job.parameters ?? {});
    this.onChange(this, { kind: "job" });
  }

  /** A mesh in a moment, unless the real one comes first. @param {Token} token */
  async preview({ signal }) {
    const { job } = this;
    if (!job) return;
    const target = ["density", "size"].find((name) => this.parameters[name]);
    const reading = this.reading();
    const asked = target ? { ...reading, [target]: this.parameters[target] } : reading;
    const { points, psnr } = await api.preview(job.id, asked, signal);
    if (signal.aborted || this.job?.id !== job.id || this.stage !== "none") return;
    this.stage = "preview";
    this.psnr = psnr;
    this.setPoints(points);
  }

  /** The parameters by which the picture is read. @returns {Parameters} */
  reading() {
    return Object.fromEntries(Object.entries(this.parameters).filter(([name]) => name === "alpha" || name === "lenient"));
  }

  /** Follows the job to its end, and takes its mesh. @param {Token} token */
  async follow({ signal }) {
    const id = this.job?.id;
    if (!this.job || !id) return;
    let points = null;
    if (!api.isFinal(this.job.state)) {
      for await (const { state, attempt, progress } of api.follow(id, signal, (isLost) => this.setLost(isLost))) {
        if (this.job) this.job = { ...this.job, state, attempt, progress };
        this.onChange(this, { kind: "job" });
      }
      // Both at once: on slow networks each answer takes its time.
      const isKnown = this.job.state === "completed" && this.parameters.format === "progression";
      [this.job, points] = await Promise.all([api.job(id, signal), isKnown ? api.mesh(id, true, signal) : null]);
    }
    if (this.job.state === "completed") {
      points ??= await api.mesh(id, Boolean(this.job.links.progression), signal);
      signal.throwIfAborted();
      this.stage = "final";
      this.psnr = this.job.mesh?.psnr_db;
      this.setPoints(points);
    }
    this.onChange(this, { kind: "job" });
  }

  /** @param {boolean} isLost */
  setLost(isLost) {
    if (isLost === this.isLost) return;
    this.isLost = isLost;
    this.onChange(this, { kind: "job" });
  }

  /** @param {Points} points */
  setPoints(points) {
    this.points = points;
    this.generation++;
    this.curve = this.isProgressive ? this.wholeCurve(points) : new Map();
    this.order({ kind: "points", points, generation: this.generation });
    this.size = 0;
    this.show(points.xs.length);
    this.onChange(this, { kind: "points" });
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

  /** The geometry of a size, which is not drawn. @param {number} size @returns {Promise<Geometry>} */
  still(size) {
    this.order({ kind: "still", size });
    return new Promise((resolve) => this.stills.set(size, resolve));
  }

  /** @param {import("./looks.js").Look} look */
  setLook(look) {
    this.look = look;
    if (this.worker) this.order({ kind: "look", look });
  }

  /** @param {import("./worker.js").Order} order */
  order(order) {
    if (!this.worker) {
      this.worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
      this.worker.onmessage = ({ data }) => this.receive(data);
      this.worker.postMessage({ kind: "look", look: this.look });
    }
    this.worker.postMessage(order);
  }

  /** Where the mesh that is seen is; null where it has no job. @param {string} format @param {Parameters} [writing]  How it is written. */
  meshPath(format, writing = {}) {
    const { job, size, most } = this;
    return job && api.meshPath(job.id, { ...(size < most ? { size: String(size) } : {}), format, ...writing });
  }

  /** @param {import("./worker.js").News} news */
  receive(news) {
    if (news.kind === "density") {
      this.onChange(this, news);
    } else if (news.kind === "still") {
      this.stills.get(news.size)?.(news.geometry);
      this.stills.delete(news.size);
    } else if (news.generation === this.generation) {
      this.faceCount = news.geometry.faceCount;
      this.onChange(this, news);
    }
  }
}

/** @param {Record<string, unknown>} values @returns {Parameters} */
function asTexts(values) {
  return Object.fromEntries(Object.entries(values).map(([name, value]) => [name, String(value)]));
}
