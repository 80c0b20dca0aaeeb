// The jobs of this browser, with the pictures they were made of: kept here and nowhere else.

/**
 * @typedef {object} Entry
 * @property {string} id  The job's.
 * @property {number} at  Milliseconds since 1970.
 * @property {string} name  The picture's.
 * @property {Blob} file
 * @property {Blob | null} thumbnail
 * @property {string} method
 * @property {number} vertices
 * @property {number | null} psnr
 */

const MOST = 24;

/** @returns {Promise<IDBDatabase>} */
function opened() {
  return new Promise((resolve, reject) => {
    const opening = indexedDB.open("pixmesh", 1);
    opening.onupgradeneeded = () => opening.result.createObjectStore("jobs", { keyPath: "id" });
    opening.onsuccess = () => resolve(opening.result);
    opening.onerror = () => reject(opening.error);
  });
}

/**
 * @template T
 * @param {IDBTransactionMode} mode @param {(store: IDBObjectStore) => IDBRequest<T>} work
 * @returns {Promise<T>}
 */
async function within(mode, work) {
  const database = await opened();
  return new Promise((resolve, reject) => {
    const asked = work(database.transaction("jobs", mode).objectStore("jobs"));
    asked.onsuccess = () => resolve(asked.result);
    asked.onerror = () => reject(asked.error);
  }).finally(() => database.close());
}

/** The newest first. @returns {Promise<Entry[]>} */
export async function entries() {
  /** @type {Entry[]} */
  const all = await within("readonly", (store) => store.getAll());
  return all.sort((a, b) => b.at - a.at);
}

/** @param {string} id @returns {Promise<Entry | undefined>} */
export function entry(id) {
  return within("readonly", (store) => store.get(id));
}

/** Adds a job; the oldest ones give way. @param {Entry} added */
export async function remember(added) {
  await within("readwrite", (store) => store.put(added));
  for (const { id } of (await entries()).slice(MOST)) await forget(id);
}

/** @param {string} id */
export async function forget(id) {
  await within("readwrite", (store) => store.delete(id));
}

/**
 * A small picture of a file.
 * @param {Blob} file
 * @returns {Promise<Blob | null>}
 */
export async function thumbnailOf(file) {
  try {
    const image = await createImageBitmap(file);
    const scale = 112 / Math.max(image.width, image.height);
    const canvas = new OffscreenCanvas(Math.max(1, Math.round(image.width * scale)), Math.max(1, Math.round(image.height * scale)));
    canvas.getContext("2d")?.drawImage(image, 0, 0, canvas.width, canvas.height);
    image.close();
    return await canvas.convertToBlob({ type: "image/jpeg", quality: 0.8 });
  } catch {
    return null;
  }
}
