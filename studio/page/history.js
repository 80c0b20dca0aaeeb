// The jobs of this browser, with the pictures they were made of: kept here and nowhere else.

/**
 * @typedef {object} Entry
 * @property {string} id  The job's.
 * @property {number} at  Milliseconds since 1970.
 * @property {string} name  The picture's.
 * @property {string} picture  The digest of the picture, by which its file is kept once.
 * @property {string} method
 * @property {number} vertices
 * @property {number | null} psnr
 * @property {Blob} [file]
 * @property {Blob | null} [thumbnail]
 */

const MOST = 24;
/** Tells the other tabs. */
const channel = new BroadcastChannel("pixmesh-history");

/** @param {() => void} listener  Another tab has changed the jobs. */
export function onChange(listener) {
  channel.onmessage = listener;
}

/** @returns {Promise<IDBDatabase>} */
function opened() {
  return new Promise((resolve, reject) => {
    const opening = indexedDB.open("pixmesh", 2);
    opening.onupgradeneeded = () => {
      for (const name of opening.result.objectStoreNames) opening.result.deleteObjectStore(name);
      opening.result.createObjectStore("jobs", { keyPath: "id" });
      opening.result.createObjectStore("pictures", { keyPath: "picture" });
    };
    opening.onsuccess = () => resolve(opening.result);
    opening.onerror = () => reject(opening.error);
  });
}

/**
 * @template T
 * @param {"jobs" | "pictures"} name @param {IDBTransactionMode} mode @param {(store: IDBObjectStore) => IDBRequest<T>} work
 * @returns {Promise<T>}
 */
async function within(name, mode, work) {
  const database = await opened();
  return new Promise((resolve, reject) => {
    const asked = work(database.transaction(name, mode).objectStore(name));
    asked.onsuccess = () => resolve(asked.result);
    asked.onerror = () => reject(asked.error);
  }).finally(() => database.close());
}

/** The newest first, with their pictures. @returns {Promise<Entry[]>} */
export async function entries() {
  /** @type {Entry[]} */
  const all = await within("jobs", "readonly", (store) => store.getAll());
  /** @type {{ picture: string, file: Blob, thumbnail: Blob | null }[]} */
  const kept = await within("pictures", "readonly", (store) => store.getAll());
  const pictures = new Map(kept.map((each) => [each.picture, each]));
  return all.map((entry) => ({ ...pictures.get(entry.picture), ...entry })).sort((a, b) => b.at - a.at);
}

/** @param {string} id @returns {Promise<Entry | undefined>} */
export async function entry(id) {
  return (await entries()).find((known) => known.id === id);
}

/** Adds a job; the oldest ones give way. @param {Entry} added @param {Blob} file */
export async function remember(added, file) {
  const known = await within("pictures", "readonly", (store) => store.getKey(added.picture));
  if (!known) {
    const thumbnail = await thumbnailOf(file);
    await within("pictures", "readwrite", (store) => store.put({ picture: added.picture, file, thumbnail }));
  }
  await within("jobs", "readwrite", (store) => store.put(added));
  for (const { id } of (await entries()).slice(MOST)) await forget(id);
  channel.postMessage(null);
}

/** Forgets a job, and its picture where no other job is of it. @param {string} id */
export async function forget(id) {
  const all = await entries();
  const forgotten = all.find((known) => known.id === id);
  await within("jobs", "readwrite", (store) => store.delete(id));
  if (forgotten && !all.some((other) => other.id !== id && other.picture === forgotten.picture)) {
    await within("pictures", "readwrite", (store) => store.delete(forgotten.picture));
  }
  channel.postMessage(null);
}

/**
 * A small picture of a file.
 * @param {Blob} file
 * @returns {Promise<Blob | null>}
 */
async function thumbnailOf(file) {
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
