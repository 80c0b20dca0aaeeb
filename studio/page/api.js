// The service, as any client speaks with it: read this file as an example.

import { readModel } from "./model.js";
import { readPmesh } from "./pmesh.js";
import { ServiceError, errorOf, unreachable } from "./problems.js";

/** @typedef {import("../api").components["schemas"]["Job"]} Job */
/** @typedef {import("../api").components["schemas"]["JobEvent"]} JobEvent */
/** @typedef {import("../api").components["schemas"]["Methods"]} Methods */
/** @typedef {import("../api").components["schemas"]["PresetRow"]} PresetRow */
/** @typedef {Record<string, string>} Parameters */

const KEY = "pixmesh-key";

/** The key that requests are sent with; empty for none. */
export const key = {
  get: () => localStorage.getItem(KEY) ?? "",
  /** @param {string} value */
  set: (value) => (value ? localStorage.setItem(KEY, value) : localStorage.removeItem(KEY)),
};

/**
 * Sends a request; what is refused becomes an error with a sentence for people.
 * @param {string} path @param {RequestInit} [options]
 */
export async function request(path, options = {}) {
  const headers = new Headers(options.headers);
  if (key.get()) headers.set("authorization", `Bearer ${key.get()}`);
  let response;
  try {
    response = await fetch(path, { ...options, headers });
  } catch (error) {
    if (options.signal?.aborted) throw error;
    throw unreachable();
  }
  if (response.ok) return response;
  const isProblem = response.headers.get("content-type")?.startsWith("application/problem+json");
  throw errorOf(isProblem ? await response.json() : { title: `The service answered ${response.status}` });
}

/** Every method, parameter and format. @returns {Promise<Methods>} */
export async function methods() {
  return (await request("/v1/methods")).json();
}

/** Parameters for every purpose. @returns {Promise<PresetRow[]>} */
export async function presets() {
  return (await (await request("/v1/presets")).json()).presets;
}

/** @param {Parameters} parameters */
export function query(parameters) {
  return new URLSearchParams(parameters).toString();
}

/** A number of a header, where a perfect copy has the word "inf". @param {Response} response @param {string} name */
export function figureOf(response, name) {
  const text = response.headers.get(name);
  return text === "inf" ? Infinity : Number(text);
}

/**
 * A mesh in a moment of the picture of a job, to be seen while the real one is made.
 * @param {string} job @param {Parameters} parameters @param {AbortSignal} signal
 */
export async function preview(job, parameters, signal) {
  const path = `/v1/meshes?${query({ ...parameters, image_of: job, method: "preview", format: "pmesh" })}`;
  const response = await request(path, { method: "POST", signal });
  return { points: await readPmesh(await response.arrayBuffer()), psnr: figureOf(response, "mesh-psnr") };
}

/**
 * Submits a job. The picture is sent, unless the service has it with another job.
 * @param {{ file: Blob | null, job: string | null, weights: Blob | null }} picture @param {Parameters} parameters
 * @param {AbortSignal} signal @param {(sent: number) => void} onSent  How much is sent, 0 to 1.
 * @returns {Promise<Job>}
 */
export async function submit({ file, job, weights }, parameters, signal, onSent) {
  const asked = { ...parameters, keep_image: "true" };
  const path = `/v1/jobs?${query(job ? { ...asked, image_of: job } : asked)}`;
  if (!weights) return sent(path, job ? null : file, signal, onSent);
  const form = new FormData();
  if (!job && file) form.append("image", file);
  form.append("weights", weights, "weights.png");
  return sent(path, form, signal, onSent);
}

/**
 * Posts a body and tells how much of it is sent, which `fetch` does not.
 * @param {string} path @param {Blob | FormData | null} body @param {AbortSignal} signal @param {(sent: number) => void} onSent
 * @returns {Promise<any>}
 */
function sent(path, body, signal, onSent) {
  return new Promise((resolve, reject) => {
    const posting = new XMLHttpRequest();
    posting.open("POST", path);
    if (key.get()) posting.setRequestHeader("authorization", `Bearer ${key.get()}`);
    if (body instanceof Blob) posting.setRequestHeader("content-type", "application/octet-stream");
    posting.responseType = "json";
    posting.upload.onprogress = ({ loaded, total }) => total && onSent(loaded / total);
    posting.onerror = () => reject(unreachable());
    posting.onabort = () => reject(signal.reason);
    posting.onload = () => {
      if (posting.status < 300) resolve(posting.response);
      else reject(errorOf(posting.response ?? { title: `The service answered ${posting.status}` }));
    };
    signal.addEventListener("abort", () => posting.abort());
    posting.send(body);
  });
}

/** The picture of a job, where the service keeps it. @param {string} id @param {AbortSignal} signal */
export async function image(id, signal) {
  return (await request(`/v1/jobs/${id}/image`, { signal })).blob();
}

/** @param {string} id @param {AbortSignal} [signal] @returns {Promise<Job>} */
export async function job(id, signal) {
  return (await request(`/v1/jobs/${id}`, { signal })).json();
}

/** Cancels a job, or deletes it where it has ended. @param {string} id */
export async function cancel(id) {
  await request(`/v1/jobs/${id}`, { method: "DELETE" });
}

/**
 * Where the mesh of a job is, in a format and of a size.
 * @param {string} id @param {Parameters} parameters
 */
export function meshPath(id, parameters) {
  return `/v1/jobs/${id}/mesh?${query(parameters)}`;
}

/**
 * The mesh of a job: with every smaller size where the service keeps the order of its vertices.
 * @param {string} id @param {boolean} isOrdered @param {AbortSignal} [signal]
 */
export async function mesh(id, isOrdered, signal) {
  if (isOrdered) {
    const response = await request(meshPath(id, { format: "progression" }), { signal });
    return readPmesh(await response.arrayBuffer());
  }
  const response = await request(meshPath(id, { format: "model" }), { signal });
  return readModel(await response.text());
}

/**
 * What happens to a job, as it happens, to its end. When the connection is lost it is taken up
 * again after the last event heard, for as long as it takes.
 * @param {string} id @param {AbortSignal} signal @param {(isLost: boolean) => void} onConnection
 * @returns {AsyncGenerator<JobEvent>}
 */
export async function* follow(id, signal, onConnection) {
  let last = "", pauseMs = 250;
  for (;;) {
    try {
      /** @type {Record<string, string>} */
      const headers = last ? { "last-event-id": last } : {};
      const response = await request(`/v1/jobs/${id}/events`, { headers, signal });
      onConnection(false);
      pauseMs = 250;
      for await (const { id: number, data } of serverSentEvents(response)) {
        last = number;
        const event = /** @type {JobEvent} */ (JSON.parse(data));
        yield event;
        if (isFinal(event.state)) return;
      }
    } catch (error) {
      if (signal.aborted || (error instanceof ServiceError && !isPassing(error))) throw error;
    }
    onConnection(true);
    await pause(pauseMs, signal);
    pauseMs = Math.min(2 * pauseMs, 4000);
  }
}

/** @param {Job["state"]} state */
export function isFinal(state) {
  return state === "completed" || state === "failed" || state === "cancelled";
}

/** Whether waiting may help. @param {ServiceError} error */
function isPassing({ slug }) {
  return ["unreachable", "overloaded", "shutting-down", "quota-exceeded", "storage-unavailable"].includes(slug);
}

/** @param {Response} response */
async function* serverSentEvents(response) {
  const stream = /** @type {ReadableStream<Uint8Array>} */ (response.body);
  const reader = stream.pipeThrough(/** @type {any} */ (new TextDecoderStream())).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const blocks = text.split("\n\n");
    text = blocks.pop() ?? "";
    for (const block of blocks) {
      /** @type {Record<string, string>} */
      const fields = {};
      for (const line of block.split("\n")) {
        const at = line.indexOf(":");
        if (at > 0) fields[line.slice(0, at)] = line.slice(at + 1).trimStart();
      }
      if (fields.data) yield { id: fields.id ?? "", data: fields.data };
    }
  }
}

/** @param {number} milliseconds @param {AbortSignal} signal @returns {Promise<void>} */
function pause(milliseconds, signal) {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(resolve, milliseconds);
    signal.addEventListener("abort", () => {
      clearTimeout(timer);
      reject(signal.reason);
    });
  });
}
