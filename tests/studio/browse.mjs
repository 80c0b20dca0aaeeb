// Scenarios of the studio in one browser: node browse.mjs SCENARIO,SCENARIO http://SERVICE [MORE].
// What is printed was measured; an exit status of 0 means that all of it held.

import { browser } from "./browser.mjs";
import * as access from "./scenarios/access.mjs";
import * as drawing from "./scenarios/drawing.mjs";
import * as failures from "./scenarios/failures.mjs";
import * as jobs from "./scenarios/jobs.mjs";
import * as outcomes from "./scenarios/outcomes.mjs";
import * as pictures from "./scenarios/pictures.mjs";
import * as sharing from "./scenarios/sharing.mjs";
import * as sights from "./scenarios/sights.mjs";
import * as times from "./scenarios/times.mjs";

const scenarios = { ...access, ...drawing, ...failures, ...jobs, ...outcomes, ...pictures, ...sharing, ...sights, ...times };
for (const name of process.argv[2].split(",")) {
  const began = Date.now();
  try {
    if (!scenarios[name]) throw new Error(`there is no scenario ${name}`);
    await scenarios[name](...process.argv.slice(4));
    console.log(`${name}: ${((Date.now() - began) / 1000).toFixed(1)} s`);
  } catch (error) {
    console.error(`${name}:`, error);
    process.exitCode = 1;
  }
  for (const context of browser.contexts()) await context.close();
}
await browser.close();
// What is still listened to would keep this process alive.
process.stdin.destroy();
