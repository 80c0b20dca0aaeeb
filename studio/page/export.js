// The dialog of what can be taken away, by what it is for.

import * as api from "./api.js";
import { byId, copy, counted, make, sized } from "./dom.js";
import { MOST_SIDE, kindOfFilm, recorded } from "./movie.js";
import { parametersOf } from "./relief.js";
import { upright } from "./renderer.js";
import { flatSvg, growingSvg, isOwn, restyled } from "./vector.js";
import { isPlain } from "./looks.js";

/**
 * What can be taken away.
 * @typedef {object} Card
 * @property {string} format  Its own name, by which it is found.
 * @property {string} title
 * @property {string} about
 * @property {string} ending
 * @property {() => string | null} [path]  Where the service has it.
 * @property {() => Promise<Blob>} [make]  How the page makes it.
 */

/** Sizes of an animation. */
const FRAMES = 24;
/** Triangles of all frames of an animated SVG, at the most. */
const MOST_ANIMATED = 60_000;

export class Exporter {
  /** @param {import("./app.js").Studio} studio */
  constructor(studio) {
    this.studio = studio;
    this.dialog = byId("export-dialog", HTMLDialogElement);
    this.measuring = new AbortController();
    this.dialog.addEventListener("close", () => this.measuring.abort());
    byId("export-close", HTMLButtonElement).addEventListener("click", () => this.dialog.close());
    for (const control of this.dialog.querySelectorAll("input, select")) {
      control.addEventListener("change", () => {
        this.hearSolid();
        this.measure();
      });
    }
    /** @type {[string, Card[]][]} */
    const lists = [["cards-picture", this.pictures()], ["cards-vector", this.vectors()], ["cards-solid", this.solids()], ["cards-moving", this.films()], ["cards-data", this.data()]];
    this.cards = lists.flatMap(([, cards]) => cards);
    for (const [id, cards] of lists) byId(id, HTMLUListElement).append(...cards.map((card) => this.item(card)));
    byId("copy-image", HTMLButtonElement).addEventListener("click", (event) => {
      this.copyImage(/** @type {HTMLButtonElement} */ (event.currentTarget)).catch((error) => this.fail(error));
    });
    for (const [button, text] of [["copy-embed", "embed"], ["copy-address", "address"], ["copy-curl", "curl"]]) {
      const pressed = byId(button, HTMLButtonElement);
      pressed.addEventListener("click", () => copy(byId(text, HTMLPreElement).textContent ?? "", pressed));
    }
  }

  /** Opens the dialog at what is likely wanted. @param {{ format: string, isTextured: boolean }} [preset] */
  open({ format, isTextured } = { format: "svg", isTextured: false }) {
    const { solid } = this.studio.stage;
    byId("export-texture", HTMLInputElement).checked = isTextured;
    byId("export-failure", HTMLParagraphElement).hidden = true;
    byId("export-height", HTMLInputElement).value = String(solid.percent);
    byId("export-invert", HTMLInputElement).checked = solid.invert;
    byId("export-color", HTMLSelectElement).value = solid.color;
    byId("export-width", HTMLInputElement).value = String(solid.width);
    byId("export-base", HTMLInputElement).value = String(solid.base);
    byId("film-note", HTMLParagraphElement).textContent = this.growthNote();
    this.dialog.showModal();
    const suggested = this.dialog.querySelector(`button[data-format=${format}]`);
    this.dialog.querySelectorAll("li.suggested").forEach((item) => item.classList.remove("suggested"));
    suggested?.closest("li")?.classList.add("suggested");
    if (suggested instanceof HTMLElement) suggested.focus();
    this.measure();
  }

  /** @param {Card} card */
  item(card) {
    const button = make("button", { type: "button", "data-format": card.format }, make("strong", {}, card.title), make("span", { class: "about" }, card.about), make("span", { class: "size" }));
    button.addEventListener("click", () => this.take(card, button).catch((error) => this.fail(error)));
    return make("li", {}, button);
  }

  /** @param {Error} error */
  fail(error) {
    const said = byId("export-failure", HTMLParagraphElement);
    said.textContent = error.message;
    said.hidden = false;
  }

  /** @param {Card} card @param {HTMLButtonElement} button */
  async take(card, button) {
    const size = /** @type {HTMLElement} */ (button.querySelector(".size"));
    size.textContent = "…";
    byId("export-failure", HTMLParagraphElement).hidden = true;
    const path = card.path?.() ?? null;
    const blob = path === null ? await card.make?.() : await (await api.request(path)).blob();
    if (!blob) throw new Error("This cannot be made from this mesh.");
    size.textContent = sized(blob.size);
    const url = URL.createObjectURL(blob);
    const suffix = card.format === "progression" ? "all-sizes" : String(this.studio.tracks[0].size);
    make("a", { href: url, download: `${this.name}-${suffix}.${card.ending}` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60_000);
  }

  /** The picture's name without its ending. */
  get name() {
    return (this.studio.source?.name ?? "mesh").replace(/\.\w+$/, "");
  }

  /** Finds the bytes of every file of the service, one after another. */
  async measure() {
    this.measuring.abort();
    const { signal } = (this.measuring = new AbortController());
    for (const card of this.cards) {
      const size = /** @type {HTMLElement} */ (this.dialog.querySelector(`button[data-format=${card.format}] .size`));
      const path = card.path?.() ?? null;
      const button = /** @type {HTMLButtonElement} */ (size.parentElement);
      button.disabled = path === null && !card.make;
      size.textContent = "";
      if (path === null) continue;
      const response = await api.request(path, { method: "HEAD", signal }).catch(() => null);
      if (signal.aborted) return;
      // Text is compressed on its way, as long as nobody knows before.
      const length = response?.headers.get("content-length");
      size.textContent = length ? sized(Number(length)) : "";
      button.disabled = response === null;
    }
  }

  // Pictures.

  /** @returns {Card[]} */
  pictures() {
    return [{
      format: "png", title: "PNG", about: "For everything. Sharp at every size.", ending: "png",
      path: () => (this.scale() === 1 && isPlain(this.look) ? this.path("png", this.shaded()) : null),
      make: () => this.png(this.scale()),
    }];
  }

  /** Pixels of the file for a pixel of the picture. */
  scale() {
    const { width, height } = this.studio.stage.renderer;
    const chosen = byId("export-scale", HTMLSelectElement).value;
    return chosen === "8k" ? Math.max(1, 7680 / Math.max(width, height)) : Number(chosen);
  }

  /** The mesh as it looks, drawn sharp. @param {number} scale */
  async png(scale) {
    const { renderer } = this.studio.stage;
    const canvas = new OffscreenCanvas(Math.round(renderer.width * scale), Math.round(renderer.height * scale));
    const context = canvas.getContext("2d");
    if (!context) throw new Error("This browser has no room for so large a picture. Take a smaller one.");
    for (const { from, rows, width, height, pixels } of renderer.bands(0, scale, this.look)) {
      context.putImageData(upright(pixels, width, rows), 0, height - from - rows);
      await new Promise((resolve) => setTimeout(resolve, 0));
    }
    return canvas.convertToBlob({ type: "image/png" });
  }

  /** @param {HTMLButtonElement} button */
  async copyImage(button) {
    await navigator.clipboard.write([new ClipboardItem({ "image/png": this.png(Math.min(this.scale(), 2)) })]);
    const label = button.textContent ?? "";
    button.textContent = "Copied";
    setTimeout(() => (button.textContent = label), 1200);
  }

  // Vectors.

  /** @returns {Card[]} */
  vectors() {
    return [
      {
        format: "svg", title: "SVG as you see it", about: "For the web and for drawing programs.", ending: "svg",
        path: () => (isPlain(this.look) ? this.path("svg", this.svgParameters()) : null), make: () => this.styledSvg(),
      },
      {
        format: "svg-flat", title: "SVG in flat facets", about: "One colour a triangle: the smallest, for every program.", ending: "svg",
        path: () => this.path("svg", this.shaded()),
      },
    ];
  }

  /** @returns {api.Parameters} */
  svgParameters() {
    return this.isFlat ? this.shaded() : { shading: "gradient" };
  }

  async styledSvg() {
    const { renderer } = this.studio.stage;
    const drawn = renderer.meshes[0];
    if (!drawn) throw new Error("There is no mesh yet.");
    const size = { width: renderer.width, height: renderer.height };
    if (isOwn(this.look, this.isFlat)) return new Blob([flatSvg(drawn.geometry, size, drawn.most, this.look)], { type: "image/svg+xml" });
    const path = this.path("svg", { shading: "gradient" });
    const svg = path ? await (await api.request(path)).text() : "";
    return new Blob([restyled(svg, drawn.geometry, size, this.look)], { type: "image/svg+xml" });
  }

  // Solids.

  /** @returns {Card[]} */
  solids() {
    const shown = () => {
      return { ...this.solidParameters(false), compression: byId("export-compression", HTMLSelectElement).value };
    };
    /** @param {string} format @returns {Pick<Card, "path" | "make">} */
    const textured = (format) => ({
      path: () => (byId("export-texture", HTMLInputElement).checked ? null : this.path(format, shown())),
      make: () => this.textured({ ...shown(), format, color: "image", texture: "embed" }),
    });
    return [
      { format: "glb", title: "GLB", about: "For games, the web and Blender.", ending: "glb", ...textured("glb") },
      { format: "stl", title: "STL", about: "For 3D printers: a closed solid in millimetres.", ending: "stl", path: () => this.path("stl", this.solidParameters(true)) },
      { format: "obj", title: "OBJ", about: "For every 3D program.", ending: "obj", path: () => this.path("obj", this.solidParameters(false)) },
      { format: "ply", title: "PLY", about: "For mesh tools, with colours.", ending: "ply", path: () => this.path("ply", this.solidParameters(false)) },
      { format: "gltf", title: "glTF", about: "GLB as text.", ending: "gltf", ...textured("gltf") },
    ];
  }

  /** A file that shows the picture itself: of the mesh of this size, and the picture. @param {api.Parameters} parameters */
  async textured(parameters) {
    const path = this.path("pmesh", {}), picture = this.studio.source?.file;
    if (!path || !picture) throw new Error("The original picture is not here. Choose its file, or take the file without it.");
    const form = new FormData();
    form.append("mesh", await (await api.request(path)).blob());
    form.append("image", picture);
    return (await api.request(`/v1/conversions?${api.query(parameters)}`, { method: "POST", body: form })).blob();
  }

  /** What the fields say is what is seen in 3D. */
  hearSolid() {
    const { stage } = this.studio;
    stage.setSolid({
      percent: Number(byId("export-height", HTMLInputElement).value) || 0, invert: byId("export-invert", HTMLInputElement).checked,
      color: /** @type {import("./relief.js").Solid["color"]} */ (byId("export-color", HTMLSelectElement).value),
      width: Number(byId("export-width", HTMLInputElement).value) || 100, base: Number(byId("export-base", HTMLInputElement).value) || 0,
    });
    stage.listeners.onSolid();
  }

  /** @param {boolean} isPrinted */
  solidParameters(isPrinted) {
    const { stage: { solid, renderer } } = this.studio;
    return { ...parametersOf(solid, renderer, renderer.levels, isPrinted), ...(isPrinted ? {} : this.shaded()) };
  }

  // Films.

  /** @returns {Card[]} */
  films() {
    return [
      { format: "svg-growing", title: "Animated SVG", about: "Grows in any browser, sharp at any size.", ending: "svg", make: () => this.growing() },
      { format: "film", title: "Film", about: kindOfFilm() ? "WebM or MP4, for posts." : "This browser cannot write films.", ending: (kindOfFilm() ?? "").includes("mp4") ? "mp4" : "webm", make: kindOfFilm() ? () => this.film() : undefined },
    ];
  }

  seconds() {
    return Math.min(20, Math.max(1, Number(byId("film-seconds", HTMLInputElement).value) || 4));
  }

  growthNote() {
    const track = this.studio.tracks[0];
    if (!track.isProgressive) return "This mesh has one size, so that it cannot grow. Photo and Game sprite can.";
    return `From 8 to ${counted(this.grownSize())} vertices in ${FRAMES} steps.`;
  }

  /** The size at the end of an animation. */
  grownSize() {
    return Math.min(this.studio.tracks[0].size, MOST_ANIMATED / 10);
  }

  /** The sizes of an animation, from a few vertices to those that are seen. */
  async stills() {
    const track = this.studio.tracks[0];
    if (!track.isProgressive) throw new Error("This mesh has one size and cannot grow. Choose Photo or Game sprite first.");
    const stills = [];
    for (let i = 0; i < FRAMES; i++) {
      const size = Math.round(8 * (this.grownSize() / 8) ** (i / (FRAMES - 1)));
      stills.push(await track.still(Math.max(4, size)));
    }
    return stills;
  }

  async growing() {
    const { renderer } = this.studio.stage;
    const most = renderer.meshes[0]?.most ?? 255;
    const svg = growingSvg(await this.stills(), renderer, most, this.look, this.seconds());
    return new Blob([svg], { type: "image/svg+xml" });
  }

  async film() {
    const { renderer } = this.studio.stage;
    const kind = kindOfFilm();
    const drawn = renderer.meshes[0];
    if (!kind || !drawn) throw new Error("This browser cannot write films.");
    const scale = Math.min(1, MOST_SIDE / Math.max(renderer.width, renderer.height));
    const size = { width: Math.round(renderer.width * scale), height: Math.round(renderer.height * scale) };
    const frames = (await this.stills()).map((geometry) => {
      return (/** @type {CanvasRenderingContext2D} */ context) => renderer.paint(geometry, drawn.most, scale, this.look, context);
    });
    const progress = byId("film-note", HTMLParagraphElement);
    const film = await recorded(size, frames, this.seconds(), kind, (done) => (progress.textContent = `Recording: ${Math.round(100 * done)} %`));
    progress.textContent = `${this.seconds()} s, ${sized(film.size)}.`;
    return film;
  }

  // Data.

  /** @returns {Card[]} */
  data() {
    return [
      { format: "pmesh", title: "pmesh", about: "The smallest file, of this size alone.", ending: "pmesh", path: () => this.path("pmesh", {}) },
      { format: "progression", title: "Progression", about: "Every size in one file.", ending: "pmesh", path: () => (this.studio.tracks[0].isProgressive && this.studio.tracks[0].job ? api.meshPath(this.studio.tracks[0].job?.id ?? "", { format: "progression" }) : null) },
      { format: "model", title: "MODEL", about: "The mesh as text.", ending: "model", path: () => this.path("model", {}) },
      { format: "json", title: "JSON", about: "Figures and arrays, for programs.", ending: "json", path: () => this.path("json", {}) },
      { format: "pnm", title: "PNM", about: "The picture without compression.", ending: "pnm", path: () => this.path("pnm", this.shaded()) },
    ];
  }

  get look() {
    return this.studio.stage.scene.look;
  }

  /** Whether the faces have one colour each. */
  get isFlat() {
    return this.look.shading === "flat" || Boolean(this.studio.tracks[0].points?.faceSamples);
  }

  /** @returns {api.Parameters} */
  shaded() {
    return this.look.shading === "flat" && !this.studio.tracks[0].points?.faceSamples ? { reconstruction: "flat" } : {};
  }

  /** @param {string} format @param {api.Parameters} writing */
  path(format, writing) {
    return this.studio.tracks[0].meshPath(format, writing);
  }
}
