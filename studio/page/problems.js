// What went wrong, as a sentence with what to do.

/** @typedef {import("../api").components["schemas"]["Problem"]} Problem */

/** What is said for some problems in the place of the service's words, by the last part of their type. @type {Record<string, string>} */
const SENTENCES = {
  "body-too-large": "This file is larger than this server takes. Save it smaller or as a JPEG.",
  "component-count": "This method is for another kind of picture. Choose another method under Advanced, such as Balanced.",
  "empty-file": "This file is empty. Choose another one.",
  gone: "This mesh is no longer kept. Choose the picture again.",
  "image-decode-failed": "This picture is damaged. Open and save it in another program, or set Take damaged files under Advanced.",
  "image-too-large": "This picture is larger than this server takes. Make it smaller.",
  "job-without-image": "The server no longer has this picture. Choose the file again.",
  "not-found": "There is no such mesh: its link has ended. Choose the picture again.",
  overloaded: "The server is busy. Try again in a moment.",
  "quota-exceeded": "Too many requests. Try again in a moment.",
  "shutting-down": "The server restarts. Try again in a moment.",
  "storage-full": "The server's disk is full. Tell its operator.",
  "too-many-jobs": "Too many of your meshes wait already. Let some finish.",
  unauthorized: "This server needs an access key. Ask its operator for one.",
  "unsupported-image": "That is not a picture this server reads. Use PNG, JPEG, WebP, GIF, TIFF, BMP or PNM.",
  "unsupported-media-type": "That is not a picture. Use PNG, JPEG, WebP, GIF, TIFF, BMP or PNM.",
  "bad-request": "That is not a picture. Use PNG, JPEG, WebP, GIF, TIFF, BMP or PNM.",
  "unknown-parameter": "The server has changed. Reload the page.",
  "unknown-value": "The server has changed. Reload the page.",
};

/** What to do about other problems. @type {Record<string, string>} */
const ADVICE = {
  "attempts-exhausted": "Try a smaller picture.",
  "conflicting-parameters": "Clear one of the two.",
  "deadline-exceeded": "Ask for less detail, or use a smaller picture.",
  "degenerate-image": "Take a picture of at least two by two pixels.",
  "format-not-possible": "Choose another format.",
  internal: "Try again; if it stays, tell the operator the request's number.",
  "work-too-large": "Ask for less detail, or make the picture smaller.",
};

/** A refusal of the service, or its silence. */
export class ServiceError extends Error {
  /** @param {string} message @param {string} slug @param {string} [more]  What the service says itself. */
  constructor(message, slug, more = "") {
    super(message);
    this.slug = slug;
    this.more = more;
  }
}

/** The error of a problem document. @param {Partial<Problem>} problem */
export function errorOf(problem) {
  const slug = (problem.type ?? "").split("/").pop() ?? "";
  const detail = problem.detail ?? "";
  const retry = /** @type {{ retry_after_s?: number }} */ (problem).retry_after_s;
  const wait = retry ? ` In about ${retry} s there may be room.` : "";
  const own = SENTENCES[slug];
  if (own) return new ServiceError(`${own}${wait}`, slug, detail);
  const sentence = (detail || problem.title || "The server refused the request").replace(/[.\s]*$/, ".");
  const begun = sentence[0].toUpperCase() + sentence.slice(1);
  return new ServiceError(`${begun} ${ADVICE[slug] ?? "Change what is asked for and try again."}${wait}`, slug);
}

/** The error of a service that does not answer. */
export function unreachable() {
  return new ServiceError("The server does not answer. Check your connection, then try again.", "unreachable");
}
