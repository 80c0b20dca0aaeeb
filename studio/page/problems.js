// What went wrong, as a sentence with what to do.

/** @typedef {import("../api").components["schemas"]["Problem"]} Problem */

/** What to do about a problem, by the last part of its type. @type {Record<string, string>} */
const ADVICE = {
  "attempts-exhausted": "Try a smaller picture, and tell the operator the request's number.",
  "body-too-large": "Save the picture smaller, or as a JPEG, and try again.",
  "component-count": "Choose a method for this kind of picture, such as mgprfs.",
  "conflicting-parameters": "Clear one of the two and run it again.",
  "deadline-exceeded": "Ask for fewer vertices, take a faster method such as med, or a smaller picture.",
  "degenerate-image": "Take a picture of at least two by two pixels.",
  "empty-file": "Choose another file.",
  "format-not-possible": "Choose another format.",
  gone: "Run the picture again: results are only kept for a time.",
  "image-decode-failed": "Open and save the picture in another program, then try again.",
  "image-too-large": "Make the picture smaller and try again.",
  internal: "Try again; if it stays, tell the operator the request's number.",
  "not-found": "Run the picture again.",
  overloaded: "Wait a moment and run it again.",
  "parameter-malformed": "Correct the value and run it again.",
  "parameter-out-of-range": "Change the value and run it again.",
  "quota-exceeded": "Wait a moment and run it again.",
  "shutting-down": "Wait a moment and run it again.",
  "storage-full": "Tell the operator that the disk is full.",
  "storage-unavailable": "Wait a moment and run it again.",
  "too-many-jobs": "Wait until some of your jobs are done.",
  unauthorized: "Enter your key under Key.",
  "unknown-parameter": "Reload the page: the service has changed.",
  "unknown-value": "Reload the page: the service has changed.",
  "unsupported-image": "Use PNG, JPEG, WebP, GIF, TIFF, BMP or PNM.",
  "work-too-large": "Ask for fewer vertices, or make the picture smaller.",
};

/** A refusal of the service, or its silence. */
export class ServiceError extends Error {
  /** @param {string} message @param {string} slug @param {number | undefined} retryAfterS */
  constructor(message, slug, retryAfterS = undefined) {
    super(message);
    this.slug = slug;
    this.retryAfterS = retryAfterS;
  }
}

/** The error of a problem document. @param {Partial<Problem>} problem */
export function errorOf(problem) {
  const slug = (problem.type ?? "").split("/").pop() ?? "";
  const title = problem.title ?? "The service refused the request";
  const detail = problem.detail ? `: ${problem.detail}` : "";
  const sentence = `${title}${detail}`.replace(/[.\s]*$/, ".");
  const retry = /** @type {{ retry_after_s?: number }} */ (problem).retry_after_s;
  const wait = retry ? ` It asks to wait ${retry} s.` : "";
  return new ServiceError(`${sentence} ${ADVICE[slug] ?? "Change the request and try again."}${wait}`, slug, retry);
}

/** The error of a service that does not answer. */
export function unreachable() {
  return new ServiceError("The service does not answer. Check that it runs and that you are connected, then try again.", "unreachable");
}
