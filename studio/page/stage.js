// The picture on the stage and the controls of what is seen of it.

import { byId } from "./dom.js";
import { Renderer } from "./renderer.js";
import { View } from "./view.js";

/** @typedef {import("./renderer.js").Scene} Scene */

const BLINK_MS = 450;

export class Stage {
  /**
   * @param {{ onDensity: () => void, onRelief: () => void, onRestored: () => void, onSeen: () => void,
   *   onSize: (factor: number) => void }} listeners
   */
  constructor(listeners) {
    this.listeners = listeners;
    this.canvas = byId("stage", HTMLCanvasElement);
    /** @type {Scene} */
    this.scene = {
      layer: "mesh", wireframe: false, points: false, smooth: false, split: null, errorScale: 32,
      zoom: 1, x: 0, y: 0, paneCount: 1, relief: false,
    };
    this.frame = 0;
    /** Whether blinking shows the original now. */
    this.isOriginal = false;
    this.blinking = 0;
    this.renderer = new Renderer(this.canvas, () => listeners.onRestored());
    const size = () => ({ width: this.renderer.width, height: this.renderer.height });
    this.view = new View(this.canvas, this.scene, size, this.renderer, () => this.seen());
    this.divider = byId("divider", HTMLInputElement);
    this.bindLayers();
    this.bindButtons();
    this.bindRanges();
    this.canvas.addEventListener("keydown", (event) => this.onKey(event));
  }

  /** Something else is to be seen. */
  seen() {
    this.redraw();
    const percent = `${Math.round(this.scene.zoom * 100 * (globalThis.devicePixelRatio || 1))} %`;
    const button = byId("zoom-one", HTMLButtonElement);
    button.textContent = percent;
    button.setAttribute("aria-label", `Zoom to single pixels, now ${percent}`);
    this.listeners.onSeen();
  }

  redraw() {
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this.draw();
    });
  }

  draw() {
    this.renderer.draw(this.isOriginal ? { ...this.scene, layer: "original", wireframe: false, points: false, split: null } : this.scene);
  }

  /** @param {Scene["layer"]} layer */
  setLayer(layer) {
    this.scene.layer = layer;
    const radio = /** @type {HTMLInputElement} */ (document.querySelector(`input[name=layer][value=${layer}]`));
    radio.checked = true;
    if (layer === "density") this.listeners.onDensity();
    if (this.scene.relief) this.setRelief(false);
    const hasScale = layer === "error" || layer === "density";
    byId("scale", HTMLDivElement).hidden = !hasScale;
    byId("scale-range", HTMLInputElement).hidden = layer !== "error";
    byId("scale-high", HTMLSpanElement).textContent = layer === "density" ? "densest" : `${this.scene.errorScale} levels`;
    this.seen();
  }

  bindLayers() {
    for (const radio of document.querySelectorAll("input[name=layer]")) {
      radio.addEventListener("change", () => this.setLayer(/** @type {Scene["layer"]} */ (/** @type {HTMLInputElement} */ (radio).value)));
    }
  }

  bindButtons() {
    for (const name of /** @type {const} */ (["wireframe", "points", "smooth"])) {
      byId(`${name}-button`, HTMLButtonElement).addEventListener("click", () => this.toggle(name));
    }
    byId("split-button", HTMLButtonElement).addEventListener("click", () => this.setSplit(this.scene.split === null ? 0.5 : null));
    byId("blink-button", HTMLButtonElement).addEventListener("click", () => this.setBlinking(!this.blinking));
    byId("relief-button", HTMLButtonElement).addEventListener("click", () => this.setRelief(!this.scene.relief));
    byId("zoom-in", HTMLButtonElement).addEventListener("click", () => this.view.zoomAt(1.5));
    byId("zoom-out", HTMLButtonElement).addEventListener("click", () => this.view.zoomAt(1 / 1.5));
    byId("zoom-one", HTMLButtonElement).addEventListener("click", () => this.view.press("1"));
    byId("zoom-fit", HTMLButtonElement).addEventListener("click", () => this.view.fit());
  }

  bindRanges() {
    this.divider.addEventListener("input", () => this.setSplit(Number(this.divider.value) / 1000));
    const scale = byId("scale-range", HTMLInputElement);
    scale.addEventListener("input", () => {
      this.scene.errorScale = Number(scale.value);
      byId("scale-high", HTMLSpanElement).textContent = `${scale.value} levels`;
      this.seen();
    });
    const height = byId("height-range", HTMLInputElement);
    height.addEventListener("input", () => {
      if (this.renderer.relief) this.renderer.relief.stretch = Number(height.value) / 100;
      this.redraw();
    });
  }

  /** @param {"wireframe" | "points" | "smooth"} name @param {boolean} [isOn] */
  toggle(name, isOn = !this.scene[name]) {
    this.scene[name] = isOn;
    byId(`${name}-button`, HTMLButtonElement).setAttribute("aria-pressed", String(isOn));
    this.seen();
  }

  /** @param {number | null} split */
  setSplit(split) {
    this.scene.split = split;
    const line = byId("divider-line", HTMLDivElement);
    this.divider.hidden = line.hidden = split === null;
    byId("split-button", HTMLButtonElement).setAttribute("aria-pressed", String(split !== null));
    if (split !== null) {
      this.divider.value = String(Math.round(1000 * split));
      line.style.insetInlineStart = `${100 * split}%`;
    }
    this.seen();
  }

  /** @param {boolean} isOn */
  setBlinking(isOn) {
    clearInterval(this.blinking);
    this.isOriginal = false;
    this.blinking = isOn
      ? setInterval(() => {
          this.isOriginal = !this.isOriginal;
          this.redraw();
        }, BLINK_MS)
      : 0;
    byId("blink-button", HTMLButtonElement).setAttribute("aria-pressed", String(isOn));
    this.redraw();
  }

  /** @param {boolean} isOn */
  setRelief(isOn) {
    this.scene.relief = isOn;
    byId("relief-button", HTMLButtonElement).setAttribute("aria-pressed", String(isOn));
    byId("height-control", HTMLDivElement).hidden = !isOn;
    if (isOn) {
      byId("scale", HTMLDivElement).hidden = true;
      this.setSplit(null);
      this.listeners.onRelief();
    } else if (this.scene.layer === "error" || this.scene.layer === "density") {
      byId("scale", HTMLDivElement).hidden = false;
    }
    this.seen();
  }

  /** @param {number} count */
  setPanes(count) {
    if (this.scene.paneCount === count) return;
    this.scene.paneCount = count;
    // Side by side there is no room for a third picture.
    byId("split-button", HTMLButtonElement).disabled = count > 1;
    if (count > 1) this.setSplit(null);
    if (this.view.isFitted) this.view.fit();
    else this.seen();
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    /** @type {Record<string, (() => void) | undefined>} */
    const keys = {
      m: () => this.setLayer("mesh"),
      o: () => this.setLayer("original"),
      e: () => this.setLayer("error"),
      d: () => this.setLayer("density"),
      l: () => this.setLayer("none"),
      w: () => this.toggle("wireframe"),
      p: () => this.toggle("points"),
      s: () => this.toggle("smooth"),
      x: () => byId("split-button", HTMLButtonElement).click(),
      b: () => this.setBlinking(!this.blinking),
      3: () => this.setRelief(!this.scene.relief),
      "[": () => this.listeners.onSize(1 / 1.1),
      "]": () => this.listeners.onSize(1.1),
    };
    const action = keys[event.key.toLowerCase()];
    action?.();
    if (action || this.view.press(event.key)) event.preventDefault();
  }
}
