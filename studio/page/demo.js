// The picture of the first visit: its mesh comes with the page, and costs the service nothing.

import * as api from "./api.js";
import { readPmesh } from "./pmesh.js";
import { Source } from "./source.js";

/** The size at which it rests. */
const SIZE = 600;
/** How much of it shows the original. */
const SPLIT = 0.42;

/** @param {import("./app.js").Studio} studio */
export async function showDemo(studio) {
  const { machine, helpers, stage, tracks } = studio;
  const token = (studio.token = machine.begin("ready"));
  const file = await helpers.painted("lake", 640, 480);
  const mesh = await (await api.request("/studio/lake.pmesh")).arrayBuffer();
  const source = new Source("lake.png", file, "lake");
  await helpers.look(source, stage.renderer.maxSide);
  const points = await readPmesh(mesh);
  if (!machine.isCurrent(token)) return;
  studio.source = studio.addressed = source;
  studio.preset = "photo";
  if (stage.scene.split === null) stage.setSplit(SPLIT);
  stage.toggle("wireframe", true);
  studio.showSource(source);
  studio.wantedSize ||= SIZE;
  tracks[0].present(points);
  studio.update();
}
