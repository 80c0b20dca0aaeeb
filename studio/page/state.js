// The state of the page: what goes on for the picture that is seen, and what went wrong.
//
// Each picture, run or stored job begins a generation and gets its token. A new generation aborts
// the one before, and what comes late for an old token is dropped here, in one place.

/**
 * `missing` is `ready` without the original picture, which a shared address may not have.
 * @typedef {"empty" | "uploading" | "working" | "previewing" | "ready" | "missing" | "failed" | "cancelled"} Phase
 */
/** @typedef {{ generation: number, signal: AbortSignal }} Token */

/** What may follow within a generation. @type {Record<Phase, Phase[]>} */
const NEXT = {
  empty: ["failed"],
  uploading: ["working", "failed", "cancelled"],
  working: ["previewing", "ready", "missing", "failed", "cancelled"],
  previewing: ["ready", "failed", "cancelled"],
  ready: ["missing", "failed"],
  missing: ["ready", "failed"],
  failed: [],
  cancelled: [],
};

export class Machine {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {Phase} */
    this.phase = "empty";
    /** @type {Error | null} */
    this.error = null;
    /** How much of the picture the service has, 0 to 1. */
    this.sent = 0;
    this.generation = 0;
    this.aborter = new AbortController();
  }

  /** Begins a generation; the one before ends. @param {"uploading" | "working" | "ready"} phase @returns {Token} */
  begin(phase) {
    this.aborter.abort();
    this.aborter = new AbortController();
    this.generation++;
    [this.phase, this.error, this.sent] = [phase, null, 0];
    this.onChange();
    return { generation: this.generation, signal: this.aborter.signal };
  }

  /** @param {Token} token */
  isCurrent({ generation }) {
    return generation === this.generation;
  }

  /** Goes on to a phase, unless the token is of an old generation. @param {Token} token @param {Phase} phase @param {Error} [error] */
  become(token, phase, error) {
    if (!this.isCurrent(token) || phase === this.phase) return;
    if (!NEXT[this.phase].includes(phase)) throw new Error(`the page cannot go from ${this.phase} to ${phase}`);
    this.phase = phase;
    this.error = error ?? null;
    this.onChange();
  }

  /** Says how much of the picture is sent. @param {Token} token @param {number} sent */
  send(token, sent) {
    if (!this.isCurrent(token)) return;
    this.sent = sent;
    this.onChange();
  }

  /** Stops what goes on. */
  cancel() {
    if (!this.isBusy) return;
    this.aborter.abort();
    this.phase = "cancelled";
    this.onChange();
  }

  /** A mistake that does not end what is shown, or none. @param {Error | null} error */
  tell(error) {
    this.error = error;
    this.onChange();
  }

  get isBusy() {
    return this.phase === "uploading" || this.phase === "working" || this.phase === "previewing";
  }

  /** Whether there is a mesh to take away. */
  get hasMesh() {
    return this.phase === "ready" || this.phase === "missing";
  }
}
