// Draws SVG and glTF files in Chromium, the latter with three.js, and writes what is seen as PNG.
//
// Standard input holds a JSON array of jobs: the path of the file, its width and height in pixels,
// the CSS colour of the background, and the path of the PNG. The browser is named by CHROMIUM; it is
// answered from the files beside this one, never from a network. A line of JSON for each job gives
// the errors that the page had.
import { readFile } from "node:fs/promises";
import { extname, join } from "node:path";
import { chromium } from "playwright-core";

const ORIGIN = "http://render.invalid";
const TYPES = { ".js": "text/javascript", ".html": "text/html", ".glb": "model/gltf-binary", ".gltf": "model/gltf+json" };
const PAGE = `<!doctype html>
<script type="importmap">{"imports": {"three": "/node_modules/three/build/three.module.js"}}</script>
<style>body { margin: 0 } canvas { display: block }</style>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "/node_modules/three/examples/jsm/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "/node_modules/three/examples/jsm/libs/meshopt_decoder.module.js";

// A pixel of the picture is a pixel of the view, whose middle is a lattice point.
window.draw = async (address, width, height, background, tilt) => {
  const loader = new GLTFLoader();
  loader.setMeshoptDecoder(MeshoptDecoder);
  const { scene } = await loader.loadAsync(address);
  const renderer = new THREE.WebGLRenderer({ antialias: false, alpha: false });
  renderer.setSize(width, height);
  const camera = new THREE.OrthographicCamera(-0.5, width - 0.5, height - 0.5, -0.5, 1, 10000);
  camera.position.z = 5000;
  const world = new THREE.Scene();
  world.background = new THREE.Color(background);
  world.add(scene);
  const light = new THREE.DirectionalLight(0xffffff, 3);
  light.position.set(-1, 1, 1.5);
  world.add(light, new THREE.AmbientLight(0xffffff, 0.4));
  if (tilt) {
    scene.position.set(-width / 2, -height / 2, 0);
    const pivot = new THREE.Group();
    pivot.add(scene);
    pivot.rotation.x = -tilt;
    pivot.position.set(width / 2, height / 2, 0);
    world.add(pivot);
  }
  document.body.append(renderer.domElement);
  renderer.render(world, camera);
};
window.ready = true;
</script>`;

const jobs = JSON.parse(await readFile("/dev/stdin", "utf8"));
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--force-color-profile=srgb"],
});
try {
  const page = await browser.newPage({ deviceScaleFactor: 1 });
  let errors = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (message) => {
    if (message.type() === "error") errors.push(message.text());
  });
  let file = "";
  await page.route("**/*", async (route) => {
    const { pathname } = new URL(route.request().url());
    if (pathname === "/") return route.fulfill({ contentType: "text/html", body: PAGE });
    if (pathname === "/favicon.ico") return route.fulfill({ status: 204 });
    const path = pathname.startsWith("/file") ? file : join(import.meta.dirname, pathname);
    const contentType = TYPES[extname(path)] ?? "application/octet-stream";
    return route.fulfill({ contentType, body: await readFile(path) });
  });
  for (const { path, width, height, background, out, tilt } of jobs) {
    errors = [];
    file = path;
    await page.setViewportSize({ width, height });
    if (extname(path) === ".svg") {
      const svg = await readFile(path, "utf8");
      await page.setContent(`<body style="margin:0;background:${background}">${svg}</body>`);
    } else {
      await page.goto(`${ORIGIN}/`);
      await page.waitForFunction(() => window.ready);
      const draw = ([...job]) => window.draw(...job);
      await page.evaluate(draw, [`/file${extname(path)}`, width, height, background, tilt ?? 0]);
    }
    await page.screenshot({ path: out, clip: { x: 0, y: 0, width, height } });
    console.log(JSON.stringify({ path, errors }));
  }
} finally {
  await browser.close();
}
