// A mesh of a picture as a job with fetch, in a browser and in Node.js.
//
// EventSource cannot send a key, so the events are read from the answer itself.

import { Refused, save } from "./mesh.mjs";

const FINAL = new Set(["completed", "failed", "cancelled"]);

/** Calls to one service. */
export class Service {
  constructor(url, { key, signal } = {}) {
    this.url = url;
    this.signal = signal;
    this.headers = key ? { authorization: `Bearer ${key}` } : {};
  }

  async call(path, { headers, ...init } = {}) {
    const answer = await fetch(this.url + path, {
      ...init,
      headers: { ...this.headers, ...headers },
      signal: this.signal,
    });
    if (!answer.ok) throw new Refused(await answer.json());
    return answer;
  }

  /** The path of a new job, or of the same one as before where `word` was given before. */
  async submit(picture, parameters, word) {
    const headers = { "content-type": "application/octet-stream", "idempotency-key": word };
    const target = `/v1/jobs?${new URLSearchParams(parameters)}`;
    const answer = await this.call(target, { method: "POST", headers, body: picture });
    return answer.headers.get("location");
  }

  /** What happens to a job, until its end; where the connection breaks, it goes on from there. */
  async *events(job) {
    let last;
    for (;;) {
      try {
        const headers = last === undefined ? {} : { "last-event-id": last };
        const answer = await this.call(`${job}/events`, { headers });
        for await (const { id, data } of messages(answer.body)) {
          last = id;
          const event = JSON.parse(data);
          yield event;
          if (FINAL.has(event.state)) return;
        }
      } catch (error) {
        if (error instanceof Refused || this.signal?.aborted) throw error;
      }
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  }

  /** The job's mesh in a format, as bytes. */
  async mesh(job, format) {
    return (await this.call(`${job}/mesh?format=${format}`)).arrayBuffer();
  }

  /** What is known of the job. */
  async status(job) {
    return (await this.call(job)).json();
  }

  /** Stops the job's work and forgets it. */
  async cancel(job) {
    await this.call(job, { method: "DELETE" });
  }
}

/** The messages of a stream of server-sent events. */
async function* messages(body) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const blocks = text.split("\n\n");
    text = blocks.pop();
    for (const block of blocks) {
      const fields = Object.fromEntries(block.split("\n").map((line) => line.split(/: ?(.*)/s)));
      if (fields.data !== undefined) yield fields;
    }
  }
}

/** Saves a mesh in mesh.glb. */
async function main(path, ...pairs) {
  if (path === undefined) {
    console.error("usage: node examples/job.mjs PICTURE [NAME=VALUE ...]");
    process.exit(2);
  }
  const { readFile } = await import("node:fs/promises");
  const { createHash } = await import("node:crypto");
  const url = process.env.PIXMESH_URL ?? "http://127.0.0.1:8080";
  const service = new Service(url, { key: process.env.PIXMESH_KEY });
  const parameters = pairs.length > 0 ? Object.fromEntries(pairs.map((pair) => pair.split("="))) : { density: 2 };
  try {
    const picture = await readFile(path);
    const word = createHash("sha256").update(JSON.stringify(parameters)).update(picture).digest("hex");
    const job = await service.submit(picture, parameters, word);
    for await (const { state, progress } of service.events(job)) console.log(state, progress?.stage ?? "");
    const bytes = await service.mesh(job, "glb");
    await save("mesh.glb", bytes);
    const { mesh } = await service.status(job);
    console.log(
      `${mesh.vertices} vertices, ${mesh.faces} faces, ${mesh.psnr_db.toFixed(2)} dB, ${bytes.byteLength} bytes`,
    );
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    console.error(JSON.stringify(error.problem));
    process.exitCode = 1;
  }
}

if (typeof process !== "undefined" && import.meta.filename === process.argv[1]) {
  await main(...process.argv.slice(2));
}
