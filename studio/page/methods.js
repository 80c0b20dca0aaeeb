// What the methods are, in words for people. Names, defaults and bounds come from the service.

/** @type {Record<string, { title: string, about: string }>} */
export const METHODS = {
  preview: { title: "Preview", about: "A mesh in a moment: again and again the worst triangle gets a vertex." },
  ed: { title: "Error diffusion", about: "Gray pictures. Places all vertices at once, where the picture bends." },
  med: { title: "Error diffusion, mirrored", about: "Places all vertices at once, densely where the picture bends. Very fast." },
  "med+": { title: "Error diffusion, cleaned", about: "The same, then takes out vertices that do harm: fewer of them, and closer." },
  gprfsed: { title: "Removal from a subset", about: "Gray pictures. Begins with four times the vertices and removes the least important." },
  mgprfs: { title: "Removal from a subset", about: "Begins with four times the vertices and removes whichever is missed least. Close to the best, and fast." },
  optimal: { title: "As close as possible", about: "Removal, then vertices move to where they serve the picture best. Takes longer, looks better." },
  flat: { title: "Flat colours", about: "Each triangle has one colour, like low-poly art. One size." },
  gpr: { title: "Removal from all pixels", about: "Gray pictures. Begins with a vertex in every pixel. Slow and thorough." },
  mgpr: { title: "Removal from all pixels", about: "Begins with a vertex in every pixel and removes whichever is missed least. Slow and thorough." },
  ced: { title: "Error diffusion of the luma", about: "Colour pictures. Places vertices by lightness alone." },
  cgprfsed: { title: "Removal by the luma", about: "Colour pictures. Removal from a subset that looks at lightness alone." },
  cgpr: { title: "Thorough removal by the luma", about: "Colour pictures. Removal from all pixels that looks at lightness alone." },
};

/** What the sizes to ask for are called, and where their field begins. @type {Record<string, { title: string, unit: string, start: string }>} */
export const TARGETS = {
  density: { title: "Density", unit: "% of the pixels", start: "2" },
  size: { title: "Vertices", unit: "vertices", start: "2000" },
  target_psnr: { title: "PSNR", unit: "dB at least", start: "32" },
  target_error: { title: "Mean error", unit: "a pixel at most", start: "20" },
  max_error: { title: "Largest error", unit: "levels at most", start: "40" },
};

/** The names of stages. @type {Record<string, string>} */
export const STAGES = {
  queue: "Waiting",
  decode: "Reading",
  density: "Density",
  diffuse: "Placing",
  triangulate: "Connecting",
  simplify: "Removing",
  refine: "Refining",
  order: "Ordering",
  rasterize: "Drawing",
  encode: "Writing",
};

/** The names of formats, with what they are for. @type {Record<string, string>} */
export const FORMATS = {
  model: "MODEL, the mesh as text",
  pmesh: "pmesh, the smallest: every size in one file",
  glb: "GLB, for three dimensions",
  gltf: "glTF, the same as text",
  png: "PNG, the picture rebuilt",
  pnm: "PNM, the same without compression",
  svg: "SVG, for the web",
  ply: "PLY, for mesh tools",
  obj: "OBJ, for mesh tools",
  stl: "STL, for printers",
  json: "JSON, for programs",
};

/** Parameters that say how a mesh is written, which the downloads decide. */
export const OF_OUTPUT = new Set(["format", "relief", "height", "z_scale", "invert_relief", "base", "z_offset", "pixel_size", "width", "center", "up", "color", "unit", "compression", "texture", "shading", "png_compression"]);
