// What WebGL2 needs said at length: programs, textures, buffers.

/** @typedef {{ program: WebGLProgram, uniforms: Record<string, WebGLUniformLocation | null> }} Program */

/**
 * @param {WebGL2RenderingContext} gl @param {{ vertex: string, fragment: string }} sources
 * @returns {Program}
 */
export function compiled(gl, sources) {
  const program = gl.createProgram();
  for (const [kind, text] of /** @type {const} */ ([
    [gl.VERTEX_SHADER, sources.vertex],
    [gl.FRAGMENT_SHADER, sources.fragment],
  ])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`This browser's graphics refused a program: ${gl.getProgramInfoLog(program)}`);
  }
  /** @type {Record<string, WebGLUniformLocation | null>} */
  const uniforms = {};
  const count = gl.isContextLost() ? 0 : gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
  for (let i = 0; i < count; i++) {
    const name = /** @type {WebGLActiveInfo} */ (gl.getActiveUniform(program, i)).name;
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms };
}

/**
 * A texture, smooth when it is reduced.
 * @param {WebGL2RenderingContext} gl @param {number} width @param {number} height
 * @param {ArrayBufferView | null} bytes  Rows from the bottom.
 * @param {boolean} [isSingle]  One byte a pixel instead of four.
 */
export function textureOf(gl, width, height, bytes, isSingle = false) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const [stored, sent] = isSingle ? [gl.R8, gl.RED] : [gl.RGBA8, gl.RGBA];
  gl.texImage2D(gl.TEXTURE_2D, 0, stored, width, height, 0, sent, gl.UNSIGNED_BYTE, bytes);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  if (bytes) gl.generateMipmap(gl.TEXTURE_2D);
  return texture;
}

/**
 * @param {WebGL2RenderingContext} gl @param {number} target @param {ArrayBufferView} data
 */
export function bufferOf(gl, target, data) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(target, buffer);
  gl.bufferData(target, data, gl.STATIC_DRAW);
  return buffer;
}
