// A mesh that grows from its corners, once for each picture: that is what this page is about.

const GROWTH_MS = 2600;

export class Growth {
  /** @param {import("./app.js").Studio} studio */
  constructor(studio) {
    this.studio = studio;
    this.frame = 0;
  }

  get isOn() {
    return this.frame > 0;
  }

  mayMove() {
    const { scene } = this.studio.stage;
    return !matchMedia("(prefers-reduced-motion: reduce)").matches && scene.layer === "mesh" && !scene.relief;
  }

  /** Lets the mesh that is there grow. @param {number} size  At its end. */
  begin(size) {
    const { studio, studio: { curve } } = this;
    const [track] = studio.tracks, { generation, most } = track;
    const began = performance.now(), last = curve.placeOf(size, most);
    const grow = () => {
      if (generation !== track.generation) return this.end();
      const t = Math.min(1, (performance.now() - began) / GROWTH_MS);
      studio.showSize(curve.sizeAt((0.18 + 0.82 * (1 - (1 - t) ** 1.6)) * last, most));
      this.frame = t < 1 ? requestAnimationFrame(grow) : 0;
    };
    this.frame = requestAnimationFrame(grow);
  }

  end() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
  }
}
