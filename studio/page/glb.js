// The first primitive of a binary glTF file, as the service writes it.

/**
 * @typedef {object} Surface
 * @property {Float32Array} positions  Three for each vertex.
 * @property {Float32Array} colors  Four for each vertex, linear.
 * @property {Uint32Array} triangles
 */

/** @type {Record<number, [typeof Float32Array | typeof Uint16Array | typeof Uint8Array | typeof Uint32Array | typeof Int16Array, number]>} */
const KINDS = {
  5121: [Uint8Array, 255],
  5122: [Int16Array, 32767],
  5123: [Uint16Array, 65535],
  5125: [Uint32Array, 4294967295],
  5126: [Float32Array, 1],
};
/** @type {Record<string, number>} */
const LENGTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/**
 * @param {ArrayBuffer} buffer
 * @returns {Surface}
 */
export function readGlb(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== 0x46546c67) throw new Error("The service sent no GLB.");
  const length = view.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  const binary = 20 + length + 8;
  const primitive = json.meshes[0].primitives[0];
  const { POSITION, COLOR_0 } = primitive.attributes;
  const positions = Float32Array.from(numbers(json, buffer, binary, POSITION));
  const node = json.nodes[0];
  const scale = node.scale ?? [1, 1, 1], shift = node.translation ?? [0, 0, 0];
  for (let i = 0; i < positions.length; i++) positions[i] = positions[i] * scale[i % 3] + shift[i % 3];
  return {
    positions,
    // Without colours it is as gray as an unpainted thing.
    colors: COLOR_0 === undefined
      ? new Float32Array((positions.length / 3) * 4).fill(0.6)
      : fourEach(Float32Array.from(numbers(json, buffer, binary, COLOR_0)), json.accessors[COLOR_0].type),
    triangles: Uint32Array.from(numbers(json, buffer, binary, primitive.indices)),
  };
}

/**
 * The numbers of an accessor, those that are normalized between 0 and 1.
 * @param {any} json @param {ArrayBuffer} buffer @param {number} binary @param {number} index
 */
function numbers(json, buffer, binary, index) {
  const accessor = json.accessors[index], view = json.bufferViews[accessor.bufferView];
  const [Kind, most] = KINDS[accessor.componentType];
  const each = LENGTHS[accessor.type];
  const stride = (view.byteStride ?? each * Kind.BYTES_PER_ELEMENT) / Kind.BYTES_PER_ELEMENT;
  const start = binary + (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  const end = start + ((accessor.count - 1) * stride + each) * Kind.BYTES_PER_ELEMENT;
  // Aligned by a copy.
  const packed = new Kind(buffer.slice(start, end));
  const values = new Float64Array(accessor.count * each);
  for (let v = 0; v < accessor.count; v++) {
    for (let k = 0; k < each; k++) {
      const value = packed[v * stride + k];
      values[v * each + k] = accessor.normalized ? value / most : value;
    }
  }
  return values;
}

/** @param {Float32Array} colors @param {string} type */
function fourEach(colors, type) {
  if (type === "VEC4") return colors;
  const four = new Float32Array((colors.length / 3) * 4).fill(1);
  for (let v = 0; v < colors.length / 3; v++) four.set(colors.subarray(3 * v, 3 * v + 3), 4 * v);
  return four;
}
