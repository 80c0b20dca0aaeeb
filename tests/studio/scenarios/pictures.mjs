// The pictures of the page in the README: node browse.mjs pictures http://SERVICE FOLDER

import { join } from "node:path";
import { choose, finished, opened, settled } from "../browser.mjs";

export async function pictures(folder) {
  const looks = [
    ["studio.jpg", "/?sample=lake&preset=photo&n=900&show=wireframe&split=0.4", { colorScheme: "dark", viewport: { width: 1360, height: 850 } }],
    ["studio-compared.jpg", "/?sample=spheres&n=1500&compare=med", { colorScheme: "light", viewport: { width: 1360, height: 850 } }],
    ["studio-relief.jpg", "/?sample=lake&preset=terrain&n=3000&relief=1", { colorScheme: "dark", viewport: { width: 1360, height: 850 } }],
    ["studio-narrow.jpg", "/?sample=bloom&n=900&layer=none&show=wireframe", { colorScheme: "dark", viewport: { width: 390, height: 780 } }],
  ];
  for (const [file, path, options] of looks) {
    const page = await opened(path, options);
    await finished(page);
    await page.waitForFunction(() => studio.seen.every(({ stage }) => stage === "final"));
    await page.waitForFunction(() => [...document.querySelectorAll("#samples img")].every((image) => image.naturalWidth > 0));
    await page.waitForFunction(() => !document.getElementById("figure-bytes").textContent.includes("≈"));
    if (path.includes("relief")) await page.waitForFunction(() => studio.stage.renderer.relief.count > 0);
    await settled(page);
    await page.waitForTimeout(800);
    await page.screenshot({ path: join(folder, file), type: "jpeg", quality: 80 });
    await page.context().close();
  }
  const solids = [["terrain.jpg", "/?preset=terrain&n=6000&relief=1", "elevation.png"], ["print.jpg", "/?preset=print&n=6000&relief=1", "picture.png"]];
  for (const [file, path, picture] of solids) {
    const page = await opened(path, { viewport: { width: 1360, height: 850 } });
    await choose(page, join(folder, picture));
    await page.waitForFunction(() => studio.stage.renderer.relief.count > 0);
    await settled(page);
    await page.waitForTimeout(800);
    await page.evaluate(() => (document.getElementById("solid-control").style.visibility = "hidden"));
    const { x, y, width, height } = await page.locator("#stage").boundingBox();
    const clip = { x: x + width / 2 - 300, y: y + height / 2 - 165, width: 600, height: 400 };
    await page.screenshot({ path: join(folder, file), type: "jpeg", quality: 85, clip });
    await page.context().close();
  }
}
