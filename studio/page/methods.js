// What the methods and parameters are, in words for people. Names, defaults and bounds come from the service.

/** @type {Record<string, { title: string, about: string }>} */
export const METHODS = {
  preview: { title: "Preview", about: "In a moment: the worst triangle gets a vertex, again and again." },
  ed: { title: "Fast, gray", about: "Good for drafts of gray pictures. Places all vertices at once." },
  med: { title: "Fast", about: "Good for drafts. Places all vertices at once, densely where there is detail." },
  "med+": { title: "Fast, cleaned up", about: "As Fast, then removes vertices that do harm: smaller and more accurate." },
  gprfsed: { title: "Balanced, gray", about: "Good for gray photos. Starts with four times the vertices and removes the least useful." },
  mgprfs: { title: "Balanced", about: "Good for photos: close to the best, and fast." },
  optimal: { title: "Best", about: "As Balanced, then moves vertices to where they serve the picture best. Takes longer." },
  flat: { title: "Flat facets", about: "Made for one colour in each triangle, as in low-poly art. One size at a time." },
  gpr: { title: "Thorough, gray", about: "Starts with a vertex in every pixel of a gray picture. Slow." },
  mgpr: { title: "Thorough", about: "Starts with a vertex in every pixel. Slow." },
  ced: { title: "Fast, by lightness", about: "For colour pictures: places vertices by lightness alone." },
  cgprfsed: { title: "Balanced, by lightness", about: "For colour pictures: removes vertices by lightness alone." },
  cgpr: { title: "Thorough, by lightness", about: "For colour pictures: every pixel, by lightness alone. Slow." },
};

/** What can be asked for: how it is said behind the number, and where its field begins. @type {Record<string, { title: string, start: string }>} */
export const TARGETS = {
  density: { title: "% of the pixels", start: "2" },
  size: { title: "vertices", start: "2000" },
  target_psnr: { title: "dB likeness at least", start: "32" },
  target_error: { title: "average error at most", start: "20" },
  max_error: { title: "levels of error at most", start: "40" },
};

/** Advanced parameters by what they are about, with their names for people. @type {Record<string, Record<string, string>>} */
export const GROUPS = {
  "The picture": { alpha: "Transparency", lenient: "Take damaged files", meshed: "Judge by", seed: "Random seed" },
  "Placing vertices": {
    initial: "First vertices", gamma: "First vertices, times the last", initial_density: "First vertices, % of pixels", initial_size: "First vertices, number",
    policy: "Where detail is", tolerance: "Vertices off the number", scan: "Order of rows", startup: "First errors", leaky: "Lose errors at the border",
    psc_tie: "Ties of gradients",
  },
  "Smoothing": {
    smoothing: "Filter", smoothing_order: "Filter size", smoothing_direction: "Direction", double_convolution: "Two filters",
    smoothing_boundary: "Beyond the border, first filter", boundary: "Beyond the border",
  },
  "Removing and refining": {
    error_metric: "Error measured by", bad_point_removal: "Remove harmful vertices", effort: "Refinement, 0 to 9", connectivity: "Triangles follow",
    values: "Colours of vertices", reconstruction: "Triangles are", parallel: "Share the work",
  },
};

/** The names of stages. @type {Record<string, string>} */
export const STAGES = {
  queue: "Waiting for a turn",
  decode: "Reading the picture",
  density: "Finding detail",
  diffuse: "Placing vertices",
  triangulate: "Connecting",
  simplify: "Removing the least useful",
  refine: "Refining",
  order: "Sorting all sizes",
  rasterize: "Drawing",
  encode: "Finishing",
};

/** Parameters that say how a mesh is written, which the export decides. */
export const OF_OUTPUT = new Set(["format", "keep_image", "relief", "height", "z_scale", "invert_relief", "base", "z_offset", "pixel_size", "width", "center", "up", "color", "unit", "compression", "texture", "shading", "png_compression"]);
