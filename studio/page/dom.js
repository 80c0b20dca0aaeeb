// Elements of the page, found and made.

/**
 * The element of an id, which is there and of a kind.
 * @template {Element} T
 * @param {string} id @param {new () => T} Kind
 * @returns {T}
 */
export function byId(id, Kind) {
  const found = document.getElementById(id);
  if (!(found instanceof Kind)) throw new Error(`the page has no ${Kind.name} called ${id}`);
  return found;
}

/**
 * A new element with attributes and children; properties of `true` are attributes without a value.
 * @template {keyof HTMLElementTagNameMap} N
 * @param {N} name @param {Record<string, string | boolean>} [attributes]
 * @param {(Node | string)[]} children
 * @returns {HTMLElementTagNameMap[N]}
 */
export function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== false) element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

/**
 * Makes the items of a list those of some keys. The items that stay are not touched but by `update`: one that were
 * replaced between the press and the release of a button would never be clicked.
 * @template T
 * @param {HTMLElement} list @param {T[]} entries @param {(entry: T) => string} keyOf
 * @param {(entry: T) => HTMLElement} create @param {(item: HTMLElement, entry: T) => void} update
 */
export function listed(list, entries, keyOf, create, update) {
  const items = new Map([...list.children].map((item) => [/** @type {HTMLElement} */ (item).dataset.key, /** @type {HTMLElement} */ (item)]));
  const kept = entries.map((entry) => {
    const item = items.get(keyOf(entry)) ?? create(entry);
    item.dataset.key = keyOf(entry);
    update(item, entry);
    return item;
  });
  for (const item of items.values()) if (!kept.includes(item)) item.remove();
  kept.forEach((item, at) => {
    if (list.children[at] !== item) list.insertBefore(item, list.children[at] ?? null);
  });
}

/** @param {string} name @param {Record<string, string | number>} attributes */
export function makeSvg(name, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  return element;
}

const whole = new Intl.NumberFormat("en");

/** @param {number} value */
export const counted = (value) => whole.format(value);

/** @param {number} bytes */
export function sized(bytes) {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 1e6) return `${(bytes / 1000).toFixed(1)} kB`;
  return `${(bytes / 1e6).toFixed(2)} MB`;
}

/** Decibels, where a perfect copy has no number. @param {number | null | undefined} psnr */
export function decibels(psnr) {
  if (psnr === undefined) return "–";
  return psnr === null || !Number.isFinite(psnr) ? "exact" : `${psnr.toFixed(2)} dB`;
}

/** @param {number} milliseconds */
export function timed(milliseconds) {
  return milliseconds < 1000 ? `${milliseconds.toFixed(0)} ms` : `${(milliseconds / 1000).toFixed(2)} s`;
}

/**
 * Puts text on the clipboard, and says so on the button that was pressed.
 * @param {string} text @param {HTMLButtonElement} button
 */
export async function copy(text, button) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Where the page is not secure there is no clipboard but by a selection.
    const area = make("textarea", { readonly: true });
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
    button.focus();
  }
  const label = button.textContent ?? "";
  button.textContent = "Copied";
  setTimeout(() => (button.textContent = label), 1200);
}
