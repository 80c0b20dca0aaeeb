// How pictures come: chosen, dropped, pasted, or one of ours.

import { byId } from "./dom.js";

/** @param {import("./app.js").Studio} studio */
export function bindPictures(studio) {
  /** @param {Iterable<File> | undefined | null} files @param {string} [otherwise]  The name of one without. */
  const take = (files, otherwise = "picture") => {
    const [file, ...more] = files ?? [];
    if (!file) return;
    studio.choose(file, file.name || otherwise);
    if (more.length) studio.machine.tell(new Error(`One picture at a time: this is ${file.name}, and ${more.length} more were left out.`));
  };
  const input = byId("file", HTMLInputElement);
  input.addEventListener("change", () => {
    take(input.files && [...input.files]);
    input.value = "";
  });
  const box = byId("stage-box", HTMLDivElement), hint = byId("drop-hint", HTMLParagraphElement);
  /** @param {boolean} isOver */
  const mark = (isOver) => {
    hint.hidden = !isOver;
    box.classList.toggle("dropping", isOver);
  };
  document.addEventListener("dragover", (event) => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    mark(true);
  });
  document.addEventListener("dragleave", (event) => event.relatedTarget === null && mark(false));
  document.addEventListener("drop", (event) => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    mark(false);
    take(event.dataTransfer.files);
  });
  document.addEventListener("paste", (event) => take(event.clipboardData?.files, "pasted.png"));
  byId("choose-button", HTMLButtonElement).addEventListener("click", () => input.click());
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("#samples button"))) {
    const name = button.dataset.sample ?? "";
    button.addEventListener("click", () => studio.chooseSample(name));
    const image = /** @type {HTMLImageElement} */ (button.querySelector("img"));
    studio.helpers.painted(name, 120, 90).then((blob) => (image.src = URL.createObjectURL(blob)));
  }
}
