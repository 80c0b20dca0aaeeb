// Zoom and pan by mouse, fingers and keyboard; in three dimensions, the orbit.

/** @typedef {import("./renderer.js").Scene} Scene */

const MOST_ZOOM = 64;

export class View {
  /**
   * @param {HTMLCanvasElement} canvas @param {Scene} scene
   * @param {() => { width: number, height: number }} size  The picture's.
   * @param {import("./renderer.js").Renderer} renderer @param {() => void} onChange
   */
  constructor(canvas, scene, size, renderer, onChange) {
    this.canvas = canvas;
    this.scene = scene;
    this.size = size;
    this.renderer = renderer;
    this.onChange = onChange;
    /** Whether the picture is kept as large as the stage allows. */
    this.isFitted = true;
    /**
     * Who may take a press before the picture is moved by it: what is returned hears of the moves, and of the end.
     * @type {((event: PointerEvent) => ((event: PointerEvent | null) => void) | null)[]}
     */
    this.takers = [];
    /** @type {((event: PointerEvent | null) => void) | null} */
    this.taken = null;
    /** @type {Map<number, { x: number, y: number }>} */
    this.pointers = new Map();
    canvas.addEventListener("wheel", (event) => this.onWheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.onDown(event));
    canvas.addEventListener("pointermove", (event) => this.onMove(event));
    for (const end of /** @type {const} */ (["pointerup", "pointercancel"])) {
      canvas.addEventListener(end, (event) => {
        this.pointers.delete(event.pointerId);
        this.taken?.(null);
        this.taken = null;
      });
    }
    canvas.addEventListener("dblclick", (event) => this.zoomAt(2, event));
    new ResizeObserver(() => (this.isFitted ? this.fit() : this.onChange())).observe(canvas);
  }

  /** Shows the whole picture. */
  fit() {
    if (this.scene.relief) this.renderer.relief?.reset();
    const { width, height } = this.size();
    const pane = this.canvas.clientWidth / this.scene.paneCount;
    this.scene.zoom = Math.max(Math.min((pane - 32) / width, (this.canvas.clientHeight - 32) / height), 1e-3);
    [this.scene.x, this.scene.y] = [width / 2, height / 2];
    this.isFitted = true;
    this.onChange();
  }

  /** @param {number} zoom */
  zoomTo(zoom) {
    const { width, height } = this.size();
    const ratio = globalThis.devicePixelRatio || 1;
    const least = Math.min(0.05, 200 / Math.max(width, height));
    this.scene.zoom = Math.min(MOST_ZOOM, Math.max(least, zoom));
    // Whole screen pixels for a pixel, where it is near.
    const side = this.scene.zoom * ratio;
    if (side >= 1 && Math.abs(side - Math.round(side)) < 0.02) this.scene.zoom = Math.round(side) / ratio;
    this.isFitted = false;
    this.keepInside();
    this.onChange();
  }

  /** Zooms by a factor, and keeps what is under the pointer there. @param {number} factor @param {{ clientX: number, clientY: number }} [at] */
  zoomAt(factor, at) {
    if (this.scene.relief) {
      this.renderer.relief?.approach(factor);
      this.onChange();
      return;
    }
    const before = at && this.pictureAt(at);
    this.zoomTo(this.scene.zoom * factor);
    if (!at || !before) return;
    const after = this.pictureAt(at);
    this.scene.x += before.x - after.x;
    this.scene.y += before.y - after.y;
    this.keepInside();
    this.onChange();
  }

  /** The place in the picture, from its lower left corner. @param {{ clientX: number, clientY: number }} at */
  pictureAt({ clientX, clientY }) {
    const box = this.canvas.getBoundingClientRect();
    const pane = box.width / this.scene.paneCount;
    const x = (clientX - box.left) % pane;
    return {
      x: this.scene.x + (x - pane / 2) / this.scene.zoom,
      y: this.scene.y - (clientY - box.top - box.height / 2) / this.scene.zoom,
    };
  }

  /** @param {number} dx @param {number} dy  In pixels of the page. */
  pan(dx, dy) {
    if (this.scene.relief) {
      this.renderer.relief?.orbit(dx, dy);
    } else {
      this.scene.x -= dx / this.scene.zoom;
      this.scene.y += dy / this.scene.zoom;
      this.isFitted = false;
      this.keepInside();
    }
    this.onChange();
  }

  keepInside() {
    const { width, height } = this.size();
    this.scene.x = Math.min(width, Math.max(0, this.scene.x));
    this.scene.y = Math.min(height, Math.max(0, this.scene.y));
  }

  /** @param {WheelEvent} event */
  onWheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    this.zoomAt(Math.exp(-event.deltaY * lines * 0.0022), event);
  }

  /** @param {PointerEvent} event */
  onDown(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size > 1) return;
    for (const taker of this.takers) this.taken ??= taker(event);
  }

  /** A finger scrolls the page over a picture that is seen whole, and moves one that is not. */
  touch() {
    this.canvas.style.touchAction = this.isFitted && !this.scene.relief && !this.scene.brush ? "pan-y" : "none";
  }

  /** @param {PointerEvent} event */
  onMove(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const moved = { x: event.clientX, y: event.clientY };
    const other = [...this.pointers.entries()].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, moved);
    if (this.taken && !other) {
      this.taken(event);
      return;
    }
    if (other) {
      const before = Math.hypot(last.x - other.x, last.y - other.y);
      const after = Math.hypot(moved.x - other.x, moved.y - other.y);
      this.zoomAt(after / Math.max(before, 1), { clientX: (moved.x + other.x) / 2, clientY: (moved.y + other.y) / 2 });
    }
    const share = other ? 0.5 : 1;
    this.pan((moved.x - last.x) * share, (moved.y - last.y) * share);
  }

  /** What a key does to the view; whether it did anything. @param {string} key */
  press(key) {
    const step = 48;
    /** @type {Record<string, () => void>} */
    const keys = {
      "+": () => this.zoomAt(1.25),
      "=": () => this.zoomAt(1.25),
      "-": () => this.zoomAt(0.8),
      0: () => this.fit(),
      1: () => this.zoomTo(1 / (globalThis.devicePixelRatio || 1)),
      ArrowLeft: () => this.pan(step, 0),
      ArrowRight: () => this.pan(-step, 0),
      ArrowUp: () => this.pan(0, step),
      ArrowDown: () => this.pan(0, -step),
    };
    keys[key]?.();
    return key in keys;
  }
}
