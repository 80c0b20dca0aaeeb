// The mesh that grows as a film, by the browser's own encoder.

/** The kinds of films that browsers write. */
const KINDS = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];
/** The longer side of a film, at the most. */
export const MOST_SIDE = 1280;

/** The kind of film that this browser writes; null for none. */
export function kindOfFilm() {
  if (!("MediaRecorder" in globalThis)) return null;
  return KINDS.find((kind) => MediaRecorder.isTypeSupported(kind)) ?? null;
}

/**
 * Records frames, each for its time, as they are drawn.
 * @param {{ width: number, height: number }} size
 * @param {((context: CanvasRenderingContext2D) => void)[]} frames @param {number} seconds @param {string} kind
 * @param {(done: number) => void} onProgress
 * @returns {Promise<Blob>}
 */
export async function recorded({ width, height }, frames, seconds, kind, onProgress) {
  const canvas = document.createElement("canvas");
  // Encoders take even sides.
  [canvas.width, canvas.height] = [2 * Math.ceil(width / 2), 2 * Math.ceil(height / 2)];
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const stream = canvas.captureStream();
  const recorder = new MediaRecorder(stream, { mimeType: kind, videoBitsPerSecond: 8_000_000 });
  /** @type {Blob[]} */
  const parts = [];
  recorder.ondataavailable = ({ data }) => parts.push(data);
  const ended = new Promise((resolve) => (recorder.onstop = resolve));
  frames[0](context);
  recorder.start();
  const last = 0.3 * seconds * 1000, each = (0.7 * seconds * 1000) / Math.max(1, frames.length - 1);
  for (const [i, frame] of frames.entries()) {
    frame(context);
    onProgress((i + 1) / frames.length);
    await pause(i + 1 < frames.length ? each : last);
  }
  // The last frame once more, so that its time is written.
  frames[frames.length - 1](context);
  await pause(60);
  recorder.stop();
  await ended;
  stream.getTracks().forEach((track) => track.stop());
  return new Blob(parts, { type: kind.split(";")[0] });
}

/** @param {number} milliseconds */
function pause(milliseconds) {
  return new Promise((resolve) => setTimeout(resolve, milliseconds));
}
