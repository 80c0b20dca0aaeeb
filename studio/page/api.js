// The service, as any client speaks with it: read this file as an example.

import { readModel } from "./model.js";
import { readPmesh } from "./pmesh.js";
import { ServiceError, errorOf, unreachable } from "./problems.js";

/** @typedef {import("../api").components["schemas"]["Job"]} Job */
/** @typedef {import("../api").components["schemas"]["JobEvent"]} JobEvent */
/** @typedef {import("../api").components["schemas"]["Methods"]} Methods */
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

/** @param {Parameters} parameters */
export function query(parameters) {
  return new URLSearchParams(parameters).toString();
}

/**
 * A mesh in a moment, to be seen while the real one is made.
 * @param {Blob} picture @param {Parameters} parameters @param {AbortSignal} signal
 */
export async function preview(picture, parameters, signal) {
  const path = `/v1/meshes?${query({ ...parameters, method: "preview", format: "pmesh" })}`;
  const response = await request(path, { method: "POST", body: picture, signal });
  const psnr = Number(response.headers.get("mesh-psnr"));
  return { points: await readPmesh(await response.arrayBuffer()), psnr };
}

/**
 * Submits a job.
 * @param {Blob} picture @param {Parameters} parameters @param {AbortSignal} signal
 * @returns {Promise<Job>}
 */
export async function submit(picture, parameters, signal) {
  const path = `/v1/jobs?${query(parameters)}`;
  return (await request(path, { method: "POST", body: picture, signal })).json();
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
 * The mesh of a job: with every smaller size where removal has left an order.
 * @param {string} id @param {AbortSignal} [signal]
 */
export async function mesh(id, signal) {
  try {
    const response = await request(meshPath(id, { format: "progression" }), { signal });
    return await readPmesh(await response.arrayBuffer());
  } catch (error) {
    // A mesh whose faces or values do not follow from its points has no order.
    if (!(error instanceof ServiceError) || isPassing(error)) throw error;
    const response = await request(meshPath(id, { format: "model" }), { signal });
    return readModel(await response.text());
  }
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
