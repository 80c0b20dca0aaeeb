// The jobs of this browser, listed beside the picture.

import * as history from "./history.js";
import { showHistory } from "./panels.js";

/** @typedef {import("./app.js").Studio} Studio */

/** @param {Studio} studio */
export async function listJobs(studio) {
  const entries = await history.entries().catch(() => []);
  showHistory(entries, studio.tracks[0].job?.id, {
    open: (entry) => studio.openJob(entry.id, entry),
    forget: async ({ id }) => {
      await history.forget(id);
      await listJobs(studio);
    },
  });
}

/** Adds the job that has ended. @param {Studio} studio @param {import("./source.js").Source} source */
export async function rememberJob(studio, source) {
  const [{ job, parameters }] = studio.tracks;
  if (!job || !source.file) return;
  await history.remember({
    id: job.id, at: Date.parse(job.created_at), name: source.name, picture: job.image?.sha256 ?? job.id,
    method: parameters.method ?? "mgprfs", vertices: job.mesh?.vertices ?? 0, psnr: job.mesh?.psnr_db ?? null,
  }, source.file);
  await listJobs(studio);
}
