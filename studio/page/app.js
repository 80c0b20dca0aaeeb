// The studio: a picture goes to the service, and its mesh is seen in every size.
//
// What happens changes the state (`state.js`), the source (`source.js`) and the tracks (`track.js`),
// and `render.js` shows all of it. The second track is the method compared with.

import { addressOf, showAsked } from "./address.js";
import * as api from "./api.js";
import { Curve } from "./curve.js";
import { showDemo } from "./demo.js";
import { byId, counted, decibels } from "./dom.js";
import { Form } from "./form.js";
import { Growth } from "./growth.js";
import * as history from "./history.js";
import { listJobs, rememberJob } from "./jobs.js";
import { PLAIN } from "./looks.js";
import { TARGETS } from "./methods.js";
import * as panels from "./panels.js";
import { findSamples, orderDensity } from "./original.js";
import { bindPictures } from "./pictures.js";
import { mostVertices, presetsOf, suited } from "./presets.js";
import { ServiceError } from "./problems.js";
import { render, settled } from "./render.js";
import { askForKey, bindSettings } from "./settings.js";
import { FirstSight } from "./sight.js";
import { showSolid } from "./solid.js";
import { Helpers, Source } from "./source.js";
import { Stage } from "./stage.js";
import { Machine } from "./state.js";
import { Track } from "./track.js";

/** @typedef {import("./state.js").Token} Token */
/** @typedef {import("./track.js").Change} Change */

const SAMPLE_SIDES = { width: 640, height: 480 };
const SETTLED_MS = 160;

export class Studio {
  constructor() {
    this.machine = new Machine(() => this.update());
    this.token = this.machine.begin("ready");
    this.machine.phase = "empty";
    this.helpers = new Helpers();
    /** @type {Source | null} */
    this.source = null;
    /** What is wanted; empty where something else is asked for. */
    this.preset = "";
    /** What there is to want, once the service has said it. @type {Map<string, import("./presets.js").Preset>} */
    this.presets = new Map();
    /** Whether the preset is chosen by hand: then it stays for the next picture. */
    this.isChosen = false;
    /** Whether the sizes have been touched: then nothing moves by itself. */
    this.isTouched = false;
    [this.settling, this.wantedSize, this.painting, this.isUpdating, this.asksRelief] = [0, 0, 0, false, false];
    /** What an address asked to be in the middle, and how large. @type {number[]} */
    this.askedView = [];
    /** The mesh that is shown in three dimensions. */
    this.reliefPath = "";
    /** What the form asked for last. */
    this.lastAsked = "";
    /** What goes on once there is a key. @type {(() => void) | null} */
    this.retry = null;
    /** The picture that the address is of. @type {Source | null} */
    this.addressed = null;
    this.stage = new Stage({
      onChange: () => this.update(),
      onDensity: () => orderDensity(this),
      onRestored: () => this.restore(),
      onSize: (factor) => this.step(factor),
      onSolid: () => showSolid(this),
      onPainted: () => this.onPainted(),
    });
    this.tracks = [0, 1].map((side) => new Track(side, (track, change) => this.onTrack(track, change)));
    this.curve = new Curve((size) => this.setSize(size), (size) => this.remake(size));
    /** The dialog of what can be taken, loaded when it is opened first. @type {Promise<import("./export.js").Exporter> | null} */
    this.exporter = null;
    this.growth = new Growth(this);
    this.sight = new FirstSight();
    /** @type {Form | null} */
    this.form = null;
    /** @type {Promise<Form> | null} */
    this.connecting = null;
  }

  /** The tracks that are seen. */
  get seen() {
    return this.form?.comparedMethod ? this.tracks : this.tracks.slice(0, 1);
  }

  async begin() {
    const asked = new URLSearchParams(location.search);
    if (asked.get("dir") === "rtl") document.documentElement.dir = "rtl";
    this.bindPage();
    bindPictures(this);
    await listJobs(this);
    await this.openFirst(asked);
  }

  /** Has what the service offers, once. @returns {Promise<Form>} */
  connect() {
    this.connecting ??= Promise.all([api.methods(), api.presets()]).then(([methods, rows]) => {
      this.presets = presetsOf(rows);
      panels.makePresets(this.presets, (name) => this.choosePreset(name));
      this.update();
      return (this.form = new Form(byId("form", HTMLFormElement), methods, (isAsked) => this.onForm(isAsked)));
    }).catch((error) => {
      this.connecting = null;
      throw error;
    });
    return this.connecting;
  }

  /** Opens what an address asks for; without anything the picture of the first visit. @param {URLSearchParams} asked */
  async openFirst(asked) {
    showAsked(asked, this.stage);
    this.setLook(this.stage.scene.look);
    this.askedView = (asked.get("view") ?? "").split(" ").map(Number);
    this.asksRelief = asked.get("relief") === "1";
    this.wantedSize = Number(asked.get("n")) || 0;
    this.isTouched = this.wantedSize > 0;
    const preset = asked.get("preset") ?? "";
    const id = asked.get("job"), name = asked.get("sample");
    if (id) {
      await this.openJob(id, await history.entry(id).catch(() => undefined), preset);
    } else if (name !== null || preset || asked.has("method")) {
      await this.attempt(this.machine.begin("uploading"), async () => {
        const form = await this.connect();
        if (this.presets.has(preset)) this.setPreset(preset, true);
        form.fill(asked);
        this.isChosen ||= asked.has("method");
        await this.chooseSample(document.querySelector(`#samples [data-sample="${CSS.escape(name ?? "")}"]`) && name ? name : "lake");
      }, () => this.openFirst(asked));
    } else {
      await showDemo(this);
      await this.attempt(this.token, async () => void (await this.connect()), () => this.connect().then(() => this.update()));
    }
  }

  // Pictures.

  /** @param {string} name */
  async chooseSample(name) {
    const file = await this.helpers.painted(name, SAMPLE_SIDES.width, SAMPLE_SIDES.height);
    await this.choose(file, `${name}.png`, name);
  }

  /** Begins with a picture. @param {Blob} file @param {string} name @param {string | null} [sample] */
  async choose(file, name, sample = null) {
    const token = this.machine.begin("uploading");
    if (!this.wantedSize) this.isTouched = false;
    const source = new Source(name, file, sample);
    this.setSource(source, token);
    document.getElementById("stage-box")?.scrollIntoView({ block: "nearest" });
    await this.attempt(token, async () => {
      // Once something is seen, which decoding would hold up.
      const looking = source.pixels.then(() => this.helpers.look(source, this.stage.renderer.maxSide)).then(() => this.machine.isCurrent(token) && this.showSource(source));
      source.looked = looking;
      // A JPEG is a photo; of others the pixels tell.
      if (!this.isChosen && file.type !== "image/jpeg") await looking;
      await this.connect();
      if (!this.machine.isCurrent(token)) return;
      if (!this.isChosen) this.setPreset(suited(source.nature));
      await this.mesh(source, token);
      await looking;
    }, () => this.choose(file, name, sample));
  }

  /** Forgets the picture before. @param {Source} source @param {Token} token */
  setSource(source, token) {
    this.growth.end();
    this.token = token;
    for (const track of this.tracks) {
      track.cancel();
      track.clear();
    }
    const { stage } = this;
    if (this.source && !this.askedView[2]) Object.assign(stage.scene, { layer: "mesh", wireframe: false, split: null });
    stage.scene.relief = false;
    stage.forgetWeights();
    stage.renderer.relief?.clear();
    stage.renderer.levels = [0, 1];
    stage.renderer.setSize(1, 1);
    this.reliefPath = "";
    this.source = source;
    panels.showThumbnails({});
    this.sight.hide();
    if (source.file) source.pixels = this.sight.show(source.file);
    stage.redraw();
    this.update();
  }

  /** Shows what the browser, or the service, sees of a picture. @param {Source} source */
  showSource(source) {
    const { bitmap } = source;
    this.sight.hide();
    if (!bitmap) return;
    source.pixels = Promise.resolve(bitmap.fullWidth * bitmap.fullHeight);
    this.stage.renderer.setOriginal(bitmap);
    this.center();
    Promise.all([this.helpers.thumbnails(bitmap), this.connect()])
      .then(([images]) => source === this.source && panels.showThumbnails(images)).catch(() => {});
    this.stage.redraw();
    this.update();
  }

  /** Shows the whole picture, or what an address has asked for. */
  center() {
    const { view, scene } = this.stage;
    const [x, y, zoom] = this.askedView;
    if (zoom > 0) {
      Object.assign(scene, { x, y });
      view.zoomTo(zoom);
      this.askedView = [];
    } else if (view.isFitted) view.fit();
  }

  // Jobs.

  /** Runs what is asked for. */
  async run() {
    const { source } = this;
    if (!source?.isThere) {
      this.machine.tell(new Error("The original picture is not here. Choose its file to make another mesh of it."));
      return;
    }
    this.growth.end();
    this.isTouched = true;
    const token = (this.token = this.machine.begin("uploading"));
    for (const side of [0, 1]) this.stage.renderer.clearMesh(side);
    this.stage.redraw();
    await this.attempt(token, () => this.mesh(source, token), () => this.run());
  }

  /** Does work of a generation; what goes wrong ends it. @param {Token} token @param {() => Promise<void>} work @param {() => void} retry  With another key. */
  async attempt(token, work, retry) {
    try {
      await work();
    } catch (reason) {
      if (token.signal.aborted || !this.machine.isCurrent(token)) return;
      const error = /** @type {Error} */ (reason);
      if (error instanceof ServiceError && error.slug === "unauthorized") {
        this.retry = retry;
        askForKey();
      }
      this.tracks.forEach((track) => track.stage !== "final" && track.clear());
      this.sight.hide();
      this.machine.become(token, "failed", error);
    }
  }

  /** Makes the meshes that are asked for: jobs first, and a preview while they run. @param {Source} source @param {Token} token */
  async mesh(source, token) {
    const form = await this.connect();
    const { size } = form.parameters(), most = this.preset && size ? mostVertices((await source.pixels) || Infinity) : Infinity;
    if (Number(size) > most) form.ask("size", String(most));
    const parameters = form.parameters(), other = form.comparedMethod;
    const [first, second] = this.tracks;
    this.stage.setPanes(other ? 2 : 1);
    if (!other) second.cancel().then(() => second.clear());
    source.weights = (await this.stage.weights?.picture()) ?? null;
    if (!this.machine.isCurrent(token)) return;
    await first.submit(source, form.ordered(parameters), token, (sent) => this.machine.send(token, sent));
    if (other) await second.submit(source, form.ordered(form.parameters(other)), token, () => {});
    this.machine.become(token, "working");
    findSamples(this, token);
    first.preview(token).catch(() => {});
    await Promise.all([first.follow(token), other ? second.follow(token) : null]);
    await this.finish(token);
  }

  /** Ends a generation as its job has ended. @param {Token} token */
  async finish(token) {
    const [{ job, most }] = this.tracks, { source } = this;
    if (!job || !source || !this.machine.isCurrent(token)) return;
    if (job.state === "failed") {
      const reason = /** @type {{ detail?: string } | null} */ (job.error);
      throw new Error(`This did not work: ${reason?.detail ?? "the server gives no reason"}. Change what is asked for and try again.`);
    }
    if (job.state === "cancelled") {
      this.machine.become(token, "cancelled");
      return;
    }
    this.machine.become(token, source.bitmap || source.file ? "ready" : "missing");
    this.say(`The mesh is ready: ${counted(most)} vertices, ${decibels(job.mesh?.psnr_db)}.`);
    const solid = this.presets.get(this.preset)?.solid;
    if (this.asksRelief || (solid && !this.stage.scene.relief)) this.stage.setRelief(true);
    this.asksRelief = false;
    if (source.file) await rememberJob(this, source).catch((error) => this.machine.tell(new Error(`History could not keep this picture: ${error.message}`)));
  }

  /** Shows a job of before. @param {string} id @param {history.Entry} [known] @param {string} [preset] */
  async openJob(id, known, preset = "") {
    const token = this.machine.begin("working");
    const source = new Source(known?.name ?? "picture", known?.file ?? null, null);
    this.setSource(source, token);
    this.isTouched = true;
    await this.attempt(token, async () => {
      const form = await this.connect();
      const [track] = this.tracks;
      await track.open(id, token);
      if (track.job?.parameters?.keep_image || track.isWorking) source.job = id;
      if (!source.file) source.file = await api.image(id, token.signal).catch(() => null);
      if (source.file) await this.helpers.look(source, this.stage.renderer.maxSide);
      if (!this.machine.isCurrent(token)) return;
      if (source.bitmap) this.showSource(source);
      this.preset = this.presets.has(preset) ? preset : "";
      form.reset(Object.fromEntries(Object.entries(track.parameters).filter(([name]) => name === "method" || name in TARGETS)));
      findSamples(this, token);
      await track.follow(token);
      await this.finish(token);
    }, () => this.openJob(id, known, preset));
  }

  /** @param {Track} track @param {Change} change */
  onTrack(track, change) {
    const { renderer } = this.stage;
    if (change.kind === "points") this.onPoints(track);
    if (change.kind === "mesh" && track.points) renderer.setMesh(track.side, change.geometry, track.points.precision);
    if (change.kind === "density") renderer.setDensity(change.map, this.source?.picture?.width ?? this.source?.bitmap?.width ?? 1, this.source?.picture?.height ?? this.source?.bitmap?.height ?? 1);
    if (change.kind !== "job") this.stage.redraw();
    this.update();
  }

  /** @param {Track} track */
  onPoints(track) {
    const { points } = track;
    const { renderer } = this.stage;
    if (!points) return;
    if (track.stage === "preview") this.machine.become(this.token, "previewing");
    if (points.width !== renderer.width || points.height !== renderer.height) {
      renderer.setSize(points.width, points.height);
      this.center();
    }
    renderer.hasAlpha = points.components === 2 || points.components === 4;
    if (!track.isProgressive) return;
    if (track.side === 1) {
      track.show(this.wantedSize || this.tracks[0].size || track.most);
    } else if (!this.isTouched && this.growth.mayMove()) {
      this.isTouched = true;
      this.growth.begin(this.wantedSize || track.most);
    } else {
      this.showSize(this.wantedSize || track.most);
    }
    if (track.side === 0) this.wantedSize = 0;
  }

  // What is asked for.

  /** @param {string} name @param {boolean} [isChosen] */
  setPreset(name, isChosen = false) {
    const wanted = this.presets.get(name);
    if (!wanted) return;
    const { parameters, look, solid } = wanted;
    [this.preset, this.isChosen] = [name, this.isChosen || isChosen];
    this.form?.reset(parameters);
    this.setLook({ ...PLAIN, ...look });
    this.stage.setSolid(solid ?? {});
    if (!solid) this.stage.scene.relief = false;
  }

  /** @param {string} name */
  choosePreset(name) {
    this.attempt(this.token, async () => {
      await this.connect();
      this.setPreset(name, true);
      this.stage.toggle("wireframe", false);
      await this.run();
    }, () => this.choosePreset(name));
  }

  /** @param {import("./looks.js").Look} look */
  setLook(look) {
    this.stage.scene.look = look;
    for (const track of this.tracks) track.setLook(look);
    this.stage.changed();
  }

  /** @param {boolean} isAsked  Whether the button is pressed. */
  onForm(isAsked) {
    const asked = JSON.stringify([this.form?.ordered(this.form.parameters()), this.form?.comparedMethod]);
    const running = JSON.stringify([this.tracks[0].parameters, this.tracks[1].job ? this.tracks[1].parameters.method : ""]);
    // A field that is left for the button tells of its change, and the button of its press.
    if (asked === this.lastAsked && (this.machine.isBusy || !isAsked)) return;
    this.lastAsked = asked;
    if (asked !== running) [this.preset, this.isChosen] = ["", true];
    this.run();
  }

  /** What is painted makes another mesh once the hand rests. */
  onPainted() {
    clearTimeout(this.painting);
    const [{ size, most }] = this.tracks;
    if (size < most) this.wantedSize = size;
    this.painting = setTimeout(() => this.run(), 700);
  }

  // Sizes.

  /** One step to fewer or more vertices. @param {number} factor */
  step(factor) {
    const { size } = this.tracks[0];
    this.setSize(factor < 1 ? Math.min(size * factor, size - 1) : Math.max(size * factor, size + 1));
  }

  /** @param {number} size */
  setSize(size) {
    this.isTouched = true;
    this.growth.end();
    this.showSize(Math.round(size));
  }

  /** @param {number} size */
  showSize(size) {
    this.stage.scene.moves = true;
    for (const track of this.seen) if (track.isProgressive) track.show(size);
    this.update();
  }

  /** Makes a mesh of a method that has one size in another. @param {number} size */
  remake(size) {
    const [track] = this.tracks;
    if (track.isProgressive || track.stage !== "final" || !this.form || size === track.size) return;
    this.form.ask("size", String(Math.round(size)));
    this.run();
  }

  /** Opens the dialog of what can be taken; the mesh of the first visit becomes one of the service before. */
  async takeAway() {
    if (this.machine.phase === "ready" && !this.tracks[0].job) await this.run();
    if (!this.machine.hasMesh) return;
    this.exporter ??= import("./export.js").then(({ Exporter }) => new Exporter(this));
    (await this.exporter).open(this.presets.get(this.preset));
  }

  /** Draws everything anew after the graphics card has lost it. */
  restore() {
    const bitmap = this.source?.bitmap;
    if (bitmap) this.stage.renderer.setOriginal(bitmap);
    this.reliefPath = "";
    this.restoreMeshes();
  }

  restoreMeshes() {
    for (const track of this.tracks) if (track.size) track.order({ kind: "show", size: track.size });
  }

  // The page.

  bindPage() {
    panels.bindCopying();
    panels.bindLook((look) => this.setLook(look));
    byId("cancel-button", HTMLButtonElement).addEventListener("click", () => {
      this.machine.cancel();
      for (const track of this.tracks) track.cancel();
      this.say("Cancelled.");
      this.stage.canvas.focus();
    });
    byId("failure-close", HTMLButtonElement).addEventListener("click", () => this.machine.tell(null));
    byId("download-button", HTMLButtonElement).addEventListener("click", () => this.takeAway());
    bindSettings(() => {
      const retry = this.retry;
      this.retry = null;
      this.machine.tell(null);
      if (retry) retry();
      else this.connect().catch((error) => this.machine.tell(error));
    });
    addEventListener("popstate", () => this.openFirst(new URLSearchParams(location.search)));
    history.onChange(() => listJobs(this));
  }

  /** Has everything shown as it is: soon what is quick, and the rest once the hand rests. */
  update() {
    clearTimeout(this.settling);
    this.settling = setTimeout(() => this.onSettled(), SETTLED_MS);
    if (this.isUpdating) return;
    this.isUpdating = true;
    queueMicrotask(() => {
      this.isUpdating = false;
      render(this);
    });
  }

  onSettled() {
    if (this.growth.isOn) return;
    if (this.stage.scene.moves) {
      this.stage.scene.moves = false;
      this.stage.redraw();
    }
    showSolid(this);
    settled(this);
    const address = addressOf(this);
    if (!this.machine.hasMesh || !this.tracks[0].job || address === location.href) return;
    if (this.source === this.addressed) globalThis.history.replaceState(null, "", address);
    else globalThis.history.pushState(null, "", address);
    this.addressed = this.source;
  }

  /** Tells those who do not see it. @param {string} text */
  say(text) {
    byId("status", HTMLParagraphElement).textContent = text;
  }
}

/** @param {unknown} reason */
function report(reason) {
  const text = reason instanceof Error ? reason.message : String(reason);
  byId("failure", HTMLDivElement).hidden = false;
  byId("failure-text", HTMLSpanElement).textContent = text;
}

addEventListener("unhandledrejection", ({ reason }) => reason?.name !== "AbortError" && report(reason));

/** The page's one studio; null where the browser cannot draw. @type {Studio | null} */
export let studio = null;
try {
  studio = new Studio();
  studio.begin().catch(report);
} catch (error) {
  report(error);
}
