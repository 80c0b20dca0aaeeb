// What is set once: the key, the colours; and the help.

import { key } from "./api.js";
import { byId } from "./dom.js";

/** @param {() => void} onKey  Another key is there: what it was needed for goes on. */
export function bindSettings(onKey) {
  bindTheme();
  const help = byId("help-dialog", HTMLDialogElement);
  byId("help-button", HTMLButtonElement).addEventListener("click", () => help.showModal());
  const dialog = byId("key-dialog", HTMLDialogElement), input = byId("key-input", HTMLInputElement);
  byId("key-button", HTMLButtonElement).addEventListener("click", askForKey);
  dialog.addEventListener("close", () => {
    if (dialog.returnValue !== "save") return;
    key.set(input.value.trim());
    onKey();
  });
  input.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    dialog.close("save");
  });
}

/** Opens the dialog for the key, where it is not open. */
export function askForKey() {
  const dialog = byId("key-dialog", HTMLDialogElement);
  if (dialog.open) return;
  byId("key-input", HTMLInputElement).value = key.get();
  dialog.returnValue = "";
  dialog.showModal();
}

function bindTheme() {
  const button = byId("theme-button", HTMLButtonElement), root = document.documentElement;
  const themes = ["system", "dark", "light"];
  /** @param {string} theme */
  const apply = (theme) => {
    if (theme === "system") delete root.dataset.theme;
    else root.dataset.theme = theme;
    button.setAttribute("aria-label", theme === "system" ? "Colours: as the system" : `Colours: ${theme}`);
    localStorage.setItem("pixmesh-theme", theme);
  };
  let at = Math.max(0, themes.indexOf(localStorage.getItem("pixmesh-theme") ?? "system"));
  apply(themes[at]);
  button.addEventListener("click", () => apply(themes[(at = (at + 1) % themes.length)]));
}
