// Scenarios of the studio in a browser: node browse.mjs SCENARIO http://SERVICE [MORE].
// What is printed was measured; an exit status of 0 means that all of it held.

import { browser } from "./browser.mjs";
import * as access from "./scenarios/access.mjs";
import * as drawing from "./scenarios/drawing.mjs";
import * as jobs from "./scenarios/jobs.mjs";
import * as pictures from "./scenarios/pictures.mjs";
import * as sharing from "./scenarios/sharing.mjs";

const scenarios = { ...access, ...drawing, ...jobs, ...pictures, ...sharing };
const name = process.argv[2];
try {
  if (!scenarios[name]) throw new Error(`there is no scenario ${name}`);
  await scenarios[name](...process.argv.slice(4));
} catch (error) {
  console.error(error);
  process.exitCode = 1;
} finally {
  await browser.close();
  // What is still listened to would keep this process alive.
  process.stdin.destroy();
}
