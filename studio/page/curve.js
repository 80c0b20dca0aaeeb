// The slider of sizes, under a curve of likeness against vertices.

import { byId, counted, decibels, makeSvg } from "./dom.js";

/** @typedef {import("./track.js").Track} Track */

const STEPS = 1000;
const MARGIN = { left: 40, right: 14, top: 10, bottom: 20 };

export class Curve {
  /** @param {(size: number) => void} onSize @param {(size: number) => void} onRest  The hand lets go. */
  constructor(onSize, onRest) {
    this.chart = byId("curve", SVGSVGElement);
    this.slider = byId("size-slider", HTMLInputElement);
    this.number = byId("size-number", HTMLInputElement);
    this.onSize = onSize;
    this.most = 4;
    /** @type {Track[]} */
    this.tracks = [];
    /** The points whose size the slider was put to last. @type {object | null} */
    this.remadeOf = null;
    this.slider.max = String(STEPS);
    this.slider.addEventListener("input", () => this.onSize(this.sizeAt(Number(this.slider.value) / STEPS)));
    this.number.addEventListener("change", () => {
      const size = Math.min(this.most, Math.max(4, Math.round(Number(this.number.value)) || 4));
      this.number.value = String(size);
      this.onSize(size);
      onRest(size);
    });
    this.slider.addEventListener("change", () => onRest(this.sizeAt(Number(this.slider.value) / STEPS)));
    this.chart.addEventListener("pointerup", () => onRest(this.sizeAt(Number(this.slider.value) / STEPS)));
    this.chart.addEventListener("pointerdown", (event) => this.drag(event));
    this.chart.addEventListener("pointermove", (event) => event.buttons && this.drag(event));
    new ResizeObserver(() => this.draw()).observe(this.chart);
  }

  /** The size at a place of 0 to 1: sizes grow by the same factor from step to step. @param {number} place @param {number} [most] */
  sizeAt(place, most = this.most) {
    return Math.round(4 * (most / 4) ** Math.min(1, Math.max(0, place)));
  }

  /** @param {number} size @param {number} [most] */
  placeOf(size, most = this.most) {
    return most > 4 ? Math.log(size / 4) / Math.log(most / 4) : 1;
  }

  /** @param {PointerEvent} event */
  drag(event) {
    if (this.slider.disabled) return;
    this.chart.setPointerCapture(event.pointerId);
    const box = this.chart.getBoundingClientRect();
    const room = box.width - MARGIN.left - MARGIN.right;
    this.onSize(this.sizeAt((event.clientX - box.left - MARGIN.left) / room));
  }

  /**
   * Shows what is known of the tracks; the first one is moved.
   * @param {Track[]} tracks @param {boolean} isRemade  Whether another size is made anew, when the hand lets go.
   */
  update(tracks, isRemade) {
    this.tracks = tracks;
    const [track] = tracks;
    this.most = Math.max(isRemade ? Math.min(20_000, 4 * track.most) : track.most, 4);
    this.slider.disabled = this.number.disabled = !track.isProgressive && !isRemade;
    if (!isRemade || document.activeElement !== this.slider || this.remadeOf !== track.points) this.slider.value = String(Math.round(STEPS * this.placeOf(Math.max(track.size, 4))));
    this.remadeOf = track.points;
    this.slider.setAttribute("aria-valuetext", `${counted(track.size)} vertices, ${decibels(track.psnr)}`);
    this.number.max = String(this.most);
    if (document.activeElement !== this.number) this.number.value = track.size ? String(track.size) : "";
    this.draw();
  }

  draw() {
    const { chart, tracks } = this;
    const width = chart.clientWidth, height = chart.clientHeight;
    if (!tracks.length || width < 80) return;
    const values = tracks.flatMap((track) => [...track.curve.values()]).filter(Number.isFinite);
    const least = Math.min(...values, 20), most = Math.max(...values, 30) + 0.5;
    const step = most - least > 60 ? 20 : most - least > 22 ? 10 : 5;
    const low = Math.floor(least / step) * step, high = Math.ceil(most / step) * step;
    const room = { x: width - MARGIN.left - MARGIN.right, y: height - MARGIN.top - MARGIN.bottom };
    /** @param {number} size */
    const x = (size) => MARGIN.left + room.x * Math.min(1, this.placeOf(size));
    /** @param {number} psnr */
    const y = (psnr) => MARGIN.top + room.y * (1 - (Math.min(psnr, high) - low) / (high - low));
    const parts = this.grid({ low, high, step }, x, y, width, height);
    for (const track of [...tracks].reverse()) {
      const isFirst = track === tracks[0];
      const points = [...track.curve].sort((a, b) => a[0] - b[0]).filter(([, psnr]) => !Number.isNaN(psnr)).map(([size, psnr]) => `${x(size).toFixed(1)} ${y(psnr).toFixed(1)}`);
      if (points.length > 1) {
        const line = `M${points.join("L")}`;
        const end = points[points.length - 1].split(" ")[0];
        const bottom = height - MARGIN.bottom;
        if (isFirst) parts.push(makeSvg("path", { d: `${line}L${end} ${bottom}L${points[0].split(" ")[0]} ${bottom}Z`, class: "area" }));
        parts.push(makeSvg("path", { d: line, class: isFirst ? "line" : "line second" }));
      }
      if (track.size && track.psnr !== undefined && !Number.isNaN(track.psnr)) {
        const at = { cx: x(track.size), cy: y(track.psnr ?? high) };
        if (isFirst) parts.push(makeSvg("line", { x1: at.cx, x2: at.cx, y1: MARGIN.top, y2: height - MARGIN.bottom, class: "cursor" }));
        parts.push(makeSvg("circle", { ...at, r: 5, class: isFirst ? "dot" : "dot second" }));
      }
    }
    chart.replaceChildren(...parts);
  }

  /**
   * @param {{ low: number, high: number, step: number }} scale @param {(size: number) => number} x
   * @param {(psnr: number) => number} y @param {number} width @param {number} height
   */
  grid({ low, high, step }, x, y, width, height) {
    const parts = [];
    /** @param {string} text @param {Record<string, string | number>} at */
    const label = (text, at) => {
      const element = makeSvg("text", at);
      element.textContent = text;
      parts.push(element);
    };
    for (let psnr = low; psnr <= high; psnr += step) {
      parts.push(makeSvg("line", { x1: MARGIN.left, x2: width - MARGIN.right, y1: y(psnr), y2: y(psnr), class: "grid" }));
      label(psnr === high ? `${psnr} dB` : String(psnr), { x: MARGIN.left - 6, y: y(psnr) + 4, "text-anchor": "end" });
    }
    for (let power = 10; x(this.most) - x(power) > 64; power *= 10) {
      if (power > this.most) break;
      parts.push(makeSvg("line", { x1: x(power), x2: x(power), y1: MARGIN.top, y2: height - MARGIN.bottom, class: "grid" }));
      label(counted(power), { x: x(power), y: height - 5, "text-anchor": "middle" });
    }
    if (this.most > 4) label(counted(this.most), { x: x(this.most), y: height - 5, "text-anchor": "end" });
    return parts;
  }
}
