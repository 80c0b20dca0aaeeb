// The service, typed by its OpenAPI document.

import { readPmesh } from "./pmesh.js";

/** @typedef {import("./schema.js").components["schemas"]} Schemas */
/** @typedef {Schemas["MeshParameters"]} Parameters */
/** @typedef {Blob | ArrayBuffer | Uint8Array<ArrayBuffer>} Picture */
/** @typedef {{ signal?: AbortSignal, idempotencyKey?: string }} Options */

/**
 * A mesh as it came, with what the service says of it.
 * @typedef {object} Answer
 * @property {ArrayBuffer} bytes
 * @property {string} type  The media type
 * @property {number} vertices
 * @property {number} faces
 * @property {number} psnr  In decibels; infinite for a perfect copy
 * @property {string} parameters  What was run, as a query
 */

/** What the service refused, or that it could not be reached. */
export class ServiceError extends Error {
  /** @param {number} status  0 where there is no answer @param {Partial<Schemas["Problem"]>} problem */
  constructor(status, problem) {
    super([problem.title, problem.detail].filter(Boolean).join(": ") || `the service answered ${status}`);
    this.name = "ServiceError";
    this.status = status;
    this.problem = problem;
  }

  /** The end of the problem's type, such as `parameter-out-of-range`; empty where there is none. */
  get slug() {
    return (this.problem.type ?? "").split("/").pop() ?? "";
  }

  /** Whether the same request may succeed later. */
  get isPassing() {
    return this.status === 0 || this.status === 429 || this.status === 503;
  }
}

/** A client of one service. */
export class Client {
  /** @param {{ url?: string, key?: string, fetch?: typeof fetch }} [settings] */
  constructor({ url = "http://127.0.0.1:8080", key, fetch: own = (...of) => fetch(...of) } = {}) {
    this.url = url.replace(/\/$/, "");
    this.key = key;
    this.fetch = own;
  }

  /** The mesh of a picture. @param {Picture} picture @param {Parameters} [parameters] @param {Options} [options] */
  async mesh(picture, parameters = {}, options = {}) {
    return answer(await this.#send("POST", "/v1/meshes", parameters, options, picture));
  }

  /**
   * The mesh of a picture with every smaller one, as points for `buffersOf`.
   * @param {Picture} picture @param {Parameters} [parameters] @param {Options} [options]
   */
  async progression(picture, parameters = {}, options = {}) {
    return readPmesh((await this.mesh(picture, { ...parameters, format: "progression" }, options)).bytes);
  }

  /**
   * Submits a job. @param {Picture} picture @param {Parameters} [parameters] @param {Options} [options]
   * @returns {Promise<Schemas["Job"]>}
   */
  async submit(picture, parameters = {}, options = {}) {
    return (await this.#send("POST", "/v1/jobs", parameters, options, picture)).json();
  }

  /** A job as it is. @param {string} id @param {Options} [options] @returns {Promise<Schemas["Job"]>} */
  async job(id, options = {}) {
    return (await this.#send("GET", `/v1/jobs/${id}`, {}, options)).json();
  }

  /** Cancels a job, or deletes it where it has ended. @param {string} id @param {Options} [options] */
  async cancel(id, options = {}) {
    await this.#send("DELETE", `/v1/jobs/${id}`, {}, options);
  }

  /**
   * What happens to a job until it ends; a lost connection is taken up again after the last event heard.
   * @param {string} id @param {Options} [options]
   * @returns {AsyncGenerator<Schemas["JobEvent"]>}
   */
  async *follow(id, options = {}) {
    let last = "", pauseMs = 250;
    for (;;) {
      try {
        const headers = last ? { "last-event-id": last } : undefined;
        const response = await this.#send("GET", `/v1/jobs/${id}/events`, {}, options, undefined, headers);
        for await (const { id: number, data } of events(response)) {
          last = number;
          pauseMs = 250;
          const event = /** @type {Schemas["JobEvent"]} */ (JSON.parse(data));
          yield event;
          if (["completed", "failed", "cancelled"].includes(event.state)) return;
        }
      } catch (error) {
        if (options.signal?.aborted || (error instanceof ServiceError && !error.isPassing)) throw error;
      }
      await new Promise((resolve) => setTimeout(resolve, pauseMs));
      options.signal?.throwIfAborted();
      pauseMs = Math.min(2 * pauseMs, 4000);
    }
  }

  /** The mesh of a completed job. @param {string} id @param {Parameters} [parameters] @param {Options} [options] */
  async meshOf(id, parameters = {}, options = {}) {
    return answer(await this.#send("GET", `/v1/jobs/${id}/mesh`, parameters, options));
  }

  /** A mesh file in another format. @param {Picture} file @param {Parameters} parameters @param {Options} [options] */
  async convert(file, parameters, options = {}) {
    return answer(await this.#send("POST", "/v1/conversions", parameters, options, file));
  }

  /** Every method, parameter and format. @param {Options} [options] @returns {Promise<Schemas["Methods"]>} */
  async methods(options = {}) {
    return (await this.#send("GET", "/v1/methods", {}, options)).json();
  }

  /** Every preset. @param {Options} [options] @returns {Promise<Schemas["Presets"]>} */
  async presets(options = {}) {
    return (await this.#send("GET", "/v1/presets", {}, options)).json();
  }

  /**
   * @param {string} method @param {string} path @param {Parameters} parameters @param {Options} options
   * @param {Picture} [body] @param {Record<string, string>} [more]
   */
  async #send(method, path, parameters, { signal, idempotencyKey }, body, more) {
    const headers = new Headers(more);
    if (this.key) headers.set("authorization", `Bearer ${this.key}`);
    if (idempotencyKey) headers.set("idempotency-key", idempotencyKey);
    if (body) headers.set("content-type", "application/octet-stream");
    const given = Object.entries(parameters).filter(([, value]) => value !== undefined);
    const query = new URLSearchParams(given.map(([name, value]) => [name, String(value)])).toString().replaceAll("+", "%20");
    let response;
    try {
      response = await this.fetch(`${this.url}${path}${query && `?${query}`}`, { method, headers, body, signal });
    } catch (error) {
      if (signal?.aborted) throw error;
      throw new ServiceError(0, { title: `${this.url} does not answer`, detail: String(error) });
    }
    if (response.ok) return response;
    const isProblem = response.headers.get("content-type")?.startsWith("application/problem+json");
    throw new ServiceError(response.status, isProblem ? await response.json() : {});
  }
}

/** @param {Response} response @returns {Promise<Answer>} */
async function answer(response) {
  const { headers } = response;
  const figure = (/** @type {string} */ name) => Number(headers.get(name)?.replace("inf", "Infinity") ?? NaN);
  return {
    bytes: await response.arrayBuffer(),
    type: headers.get("content-type") ?? "",
    vertices: figure("mesh-vertices"),
    faces: figure("mesh-faces"),
    psnr: figure("mesh-psnr"),
    parameters: headers.get("mesh-parameters") ?? "",
  };
}

/** Server-sent events. @param {Response} response */
async function* events(response) {
  const stream = /** @type {ReadableStream<Uint8Array>} */ (response.body);
  const reader = stream.pipeThrough(/** @type {any} */ (new TextDecoderStream())).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const blocks = (text + value).split("\n\n");
    text = blocks.pop() ?? "";
    for (const block of blocks) {
      const field = (/** @type {string} */ name) => block.match(new RegExp(`^${name}: ?(.*)$`, "m"))?.[1];
      const data = field("data");
      if (data) yield { id: field("id") ?? "", data };
    }
  }
}
