// The picture on the stage and the controls of what is seen of it.

import { byId } from "./dom.js";
import { PLAIN } from "./looks.js";
import { SOLID } from "./relief.js";
import { Renderer } from "./renderer.js";
import { View } from "./view.js";
import { Weights } from "./weights.js";

/** @typedef {import("./renderer.js").Scene} Scene */
/** What there is to see, and why not. @typedef {{ hasOriginal: boolean, hasMesh: boolean, isCompared: boolean }} Seeable */

const BLINK_MS = 450;
/** Pixels of the page beside the line between before and after where it is taken hold of. */
const GRIP = 14;
const WITHOUT_ORIGINAL = "The original picture is not here: choose the file to compare with it";

export class Stage {
  /**
   * @param {{ onChange: () => void, onDensity: () => void, onRestored: () => void, onSize: (factor: number) => void,
   *   onSolid: () => void, onPainted: () => void }} listeners
   */
  constructor(listeners) {
    this.listeners = listeners;
    this.canvas = byId("stage", HTMLCanvasElement);
    /** @type {Scene} */
    this.scene = {
      layer: "mesh", wireframe: false, points: false, smooth: false, split: null, errorScale: 32,
      zoom: 1, x: 0, y: 0, paneCount: 1, relief: false, moves: false, brush: false, look: PLAIN,
    };
    /** @type {import("./relief.js").Solid} */
    this.solid = { ...SOLID };
    /** @type {Weights | null} */
    this.weights = null;
    this.erases = false;
    this.frame = 0;
    /** Whether flicker shows the original now. */
    this.isOriginal = false;
    this.blinking = 0;
    this.renderer = new Renderer(this.canvas, () => listeners.onRestored());
    const size = () => ({ width: this.renderer.width, height: this.renderer.height });
    this.view = new View(this.canvas, this.scene, size, this.renderer, () => this.changed());
    this.view.takers.push((event) => this.takeLine(event), (event) => this.takeBrush(event));
    this.divider = byId("divider", HTMLInputElement);
    this.bindButtons();
    this.bindRanges();
    this.bindBrush();
    this.canvas.addEventListener("keydown", (event) => this.onKey(event));
  }

  /** Something else is to be seen. */
  changed() {
    this.redraw();
    this.listeners.onChange();
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

  /** Puts the controls as the scene is. @param {Seeable} seeable */
  show({ hasOriginal, hasMesh, isCompared }) {
    const { scene } = this;
    const is3d = scene.relief;
    this.view.touch();
    for (const radio of /** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll("input[name=layer]"))) {
      radio.checked = radio.value === scene.layer;
      const needsOriginal = radio.value === "original" || radio.value === "error" || radio.value === "density";
      radio.disabled = is3d || (needsOriginal && !hasOriginal) || (radio.value !== "original" && radio.value !== "mesh" && !hasMesh);
      const label = /** @type {HTMLElement} */ (radio.parentElement);
      label.title = is3d ? "Leave 3D to change the view" : needsOriginal && !hasOriginal ? WITHOUT_ORIGINAL : label.dataset.title ?? "";
    }
    /** @param {string} id @param {boolean} isPressed @param {string} reason  Why it cannot be pressed; empty where it can. */
    const put = (id, isPressed, reason) => {
      const button = byId(id, HTMLButtonElement);
      button.setAttribute("aria-pressed", String(isPressed && !reason));
      button.disabled = reason !== "";
      button.title = reason || (button.dataset.title ?? "");
    };
    const flat = is3d ? "Not in 3D" : hasMesh ? "" : "There is no mesh yet";
    put("wireframe-button", scene.wireframe || scene.layer === "none", flat);
    put("points-button", scene.points, flat);
    put("smooth-button", scene.smooth, flat);
    const against = flat || (hasOriginal ? "" : WITHOUT_ORIGINAL);
    put("split-button", scene.split !== null, against || (isCompared ? "Two meshes stand side by side: there is no room for a third picture" : ""));
    put("blink-button", this.blinking > 0, against);
    put("relief-button", is3d, hasMesh ? "" : "There is no mesh yet");
    put("brush-button", scene.brush, is3d ? "Not in 3D" : hasOriginal ? "" : WITHOUT_ORIGINAL);
    const hasScale = !is3d && (scene.layer === "error" || scene.layer === "density");
    byId("scale", HTMLDivElement).hidden = !hasScale;
    byId("scale-range", HTMLInputElement).hidden = scene.layer !== "error";
    byId("scale-high", HTMLSpanElement).textContent = scene.layer === "density" ? "most detail" : `${scene.errorScale} levels`;
    byId("solid-control", HTMLDivElement).hidden = !is3d;
    byId("brush-control", HTMLDivElement).hidden = !scene.brush;
    const isSplit = scene.split !== null && !against && !isCompared;
    byId("divider-line", HTMLDivElement).hidden = this.divider.hidden = !isSplit;
    if (isSplit) {
      this.divider.value = String(Math.round(1000 * (scene.split ?? 0)));
      byId("divider-line", HTMLDivElement).style.insetInlineStart = `${100 * (scene.split ?? 0)}%`;
    }
    const percent = is3d ? "3D" : `${Math.round(scene.zoom * 100 * (globalThis.devicePixelRatio || 1))} %`;
    const zoom = byId("zoom-one", HTMLButtonElement);
    zoom.textContent = percent;
    zoom.disabled = is3d;
    zoom.setAttribute("aria-label", `Zoom to single pixels, now ${percent}`);
  }

  bindButtons() {
    for (const radio of /** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll("input[name=layer]"))) {
      radio.addEventListener("change", () => this.setLayer(/** @type {Scene["layer"]} */ (radio.value)));
    }
    /** @type {Record<string, () => void>} */
    const pressed = {
      "wireframe-button": () => this.toggle("wireframe"),
      "points-button": () => this.toggle("points"),
      "smooth-button": () => this.toggle("smooth"),
      "split-button": () => this.setSplit(this.scene.split === null ? 0.5 : null),
      "blink-button": () => this.setBlinking(!this.blinking),
      "relief-button": () => this.setRelief(!this.scene.relief),
      "brush-button": () => this.setBrush(!this.scene.brush),
      "zoom-in": () => this.view.zoomAt(1.5),
      "zoom-out": () => this.view.zoomAt(1 / 1.5),
      "zoom-one": () => this.view.press("1"),
      "zoom-fit": () => this.view.fit(),
    };
    for (const [id, press] of Object.entries(pressed)) byId(id, HTMLButtonElement).addEventListener("click", press);
  }

  bindRanges() {
    this.divider.addEventListener("input", () => this.setSplit(Number(this.divider.value) / 1000));
    const scale = byId("scale-range", HTMLInputElement);
    scale.addEventListener("input", () => {
      this.scene.errorScale = Number(scale.value);
      this.changed();
    });
    const height = byId("height-range", HTMLInputElement), color = byId("solid-color", HTMLSelectElement), invert = byId("solid-invert", HTMLInputElement);
    const hear = () => {
      this.solid = {
        ...this.solid, percent: Number(height.value), invert: invert.checked,
        color: /** @type {import("./relief.js").Solid["color"]} */ (color.value),
      };
      this.listeners.onSolid();
    };
    for (const control of [height, color, invert]) control.addEventListener("input", hear);
  }

  /** @param {Partial<import("./relief.js").Solid>} solid */
  setSolid(solid) {
    this.solid = { ...SOLID, ...solid };
    byId("height-range", HTMLInputElement).value = String(this.solid.percent);
    byId("solid-color", HTMLSelectElement).value = this.solid.color;
    byId("solid-invert", HTMLInputElement).checked = this.solid.invert;
  }

  /** @param {Scene["layer"]} layer */
  setLayer(layer) {
    this.scene.layer = layer;
    this.scene.relief = false;
    if (layer === "density") this.listeners.onDensity();
    this.changed();
  }

  /** @param {"wireframe" | "points" | "smooth"} name @param {boolean} [isOn] */
  toggle(name, isOn = !this.scene[name]) {
    this.scene[name] = isOn;
    this.changed();
  }

  /** @param {number | null} split */
  setSplit(split) {
    this.scene.split = split;
    this.changed();
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
    this.changed();
  }

  /** @param {boolean} isOn */
  setRelief(isOn) {
    this.scene.relief = isOn;
    if (isOn) {
      this.setBlinking(false);
      this.scene.brush = false;
      this.listeners.onSolid();
    }
    this.changed();
  }

  /** @param {number} count */
  setPanes(count) {
    if (this.scene.paneCount === count) return;
    this.scene.paneCount = count;
    if (this.view.isFitted) this.view.fit();
    else this.changed();
  }

  // The brush.

  bindBrush() {
    byId("brush-more", HTMLInputElement).addEventListener("change", () => (this.erases = false));
    byId("brush-less", HTMLInputElement).addEventListener("change", () => (this.erases = true));
    byId("brush-undo", HTMLButtonElement).addEventListener("click", () => this.repaint(() => this.weights?.undo()));
    byId("brush-clear", HTMLButtonElement).addEventListener("click", () => this.repaint(() => this.weights?.clear()));
  }

  /** @param {() => void} change */
  repaint(change) {
    change();
    if (this.weights) this.renderer.setWeights(this.weights);
    this.redraw();
    this.listeners.onPainted();
  }

  /** @param {boolean} isOn */
  setBrush(isOn) {
    this.scene.brush = isOn;
    if (isOn && !this.weights) {
      this.weights = new Weights(this.renderer.width, this.renderer.height);
      this.renderer.setWeights(this.weights);
    }
    this.changed();
  }

  /** Forgets what was painted on another picture. */
  forgetWeights() {
    this.weights = null;
    this.scene.brush = false;
  }

  /** @param {PointerEvent} event */
  takeBrush(event) {
    const { weights } = this;
    if (!this.scene.brush || !weights || event.button > 0) return null;
    weights.begin();
    const erases = this.erases !== (event.altKey || event.shiftKey);
    let last = this.view.pictureAt(event);
    /** @param {PointerEvent | null} moved */
    const paint = (moved) => {
      if (!moved) {
        this.listeners.onPainted();
        return;
      }
      const at = this.view.pictureAt(moved);
      const radius = Number(byId("brush-size", HTMLInputElement).value) / this.scene.zoom;
      weights.stroke(last, at, radius, erases);
      last = at;
      this.renderer.setWeights(weights);
      this.redraw();
    };
    paint(event);
    return paint;
  }

  /** Paints in the middle of the stage, for the keyboard. */
  dab() {
    const { weights, scene } = this;
    if (!weights) return;
    weights.begin();
    weights.stroke(scene, scene, Number(byId("brush-size", HTMLInputElement).value) / scene.zoom, this.erases);
    this.repaint(() => {});
  }

  /** The line between before and after, wherever it is pressed. @param {PointerEvent} event */
  takeLine(event) {
    if (this.divider.hidden || this.scene.split === null) return null;
    const box = this.canvas.getBoundingClientRect();
    if (Math.abs(event.clientX - box.left - this.scene.split * box.width) > GRIP) return null;
    return (/** @type {PointerEvent | null} */ moved) => {
      if (moved) this.setSplit(Math.min(1, Math.max(0, (moved.clientX - box.left) / box.width)));
    };
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    /** @param {string} id */
    const press = (id) => () => byId(id, HTMLButtonElement).click();
    /** @param {Scene["layer"]} layer */
    const layer = (layer) => () => {
      const radio = /** @type {HTMLInputElement} */ (document.querySelector(`input[name=layer][value=${layer}]`));
      if (!radio.disabled) this.setLayer(layer);
    };
    /** @type {Record<string, (() => void) | undefined>} */
    const keys = {
      m: layer("mesh"), o: layer("original"), e: layer("error"), d: layer("density"), l: layer("none"),
      w: press("wireframe-button"), p: press("points-button"), s: press("smooth-button"),
      x: press("split-button"), b: press("blink-button"), 3: press("relief-button"), r: press("brush-button"),
      "[": () => this.listeners.onSize(1 / 1.1),
      "]": () => this.listeners.onSize(1.1),
      " ": this.scene.brush ? () => this.dab() : undefined,
    };
    const action = keys[event.key.toLowerCase()];
    action?.();
    if (action || this.view.press(event.key)) event.preventDefault();
  }
}
