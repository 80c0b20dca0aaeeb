// The programs of the graphics card.

const HEAD = `#version 300 es
precision highp float;
`;

/** A lattice point stands at the middle of its pixel; `place` maps pixels to clip space. */
const PLACED = `
uniform vec4 place;
vec4 placed(vec2 lattice) {
  return vec4((lattice + 0.5) * place.xy + place.zw, 0.0, 1.0);
}
`;

/** From black over violet and orange to a pale yellow: equal steps look equal. */
const HEAT = `
vec3 heat(float t) {
  vec3 a = vec3(0.02, 0.02, 0.06), b = vec3(0.28, 0.09, 0.44), c = vec3(0.73, 0.22, 0.40);
  vec3 d = vec3(0.97, 0.55, 0.20), e = vec3(0.99, 0.96, 0.72);
  t = clamp(t, 0.0, 1.0) * 4.0;
  if (t < 1.0) return mix(a, b, t);
  if (t < 2.0) return mix(b, c, t - 1.0);
  if (t < 3.0) return mix(c, d, t - 2.0);
  return mix(d, e, t - 3.0);
}
`;

/** Triangles with the interpolation of the method: linear, then rounded, halves up; straight colours. */
export const MESH = {
  vertex: `${HEAD}${PLACED}
layout(location = 0) in vec2 lattice;
layout(location = 1) in vec4 samples;
out vec4 value;
void main() {
  value = samples;
  gl_Position = placed(lattice);
}`,
  fragment: `${HEAD}
uniform float most;
uniform bool rounds;
uniform vec2 levels;
in vec4 value;
out vec4 color;
void main() {
  // A sum that must be a half is one within a thousandth.
  vec4 drawn = rounds ? floor(value + 0.501) : value;
  // Premultiplied colours are interpolated, and pictures hold straight ones.
  if (drawn.a < most) {
    vec3 straight = drawn.a > 0.0 ? min(drawn.rgb * most / drawn.a, most) : vec3(0.0);
    drawn.rgb = rounds ? floor(straight + 0.501) : straight;
  }
  color = drawn / most;
  if (levels != vec2(0.0, 1.0)) color.rgb = (color.rgb - levels.x) / (levels.y - levels.x);
}`,
};

/** Edges and points, drawn to be seen on whatever is behind them. */
export const MARKS = {
  vertex: `${HEAD}${PLACED}
uniform float most;
uniform float pointSize;
layout(location = 0) in vec2 lattice;
layout(location = 1) in vec4 samples;
out vec3 own;
void main() {
  own = samples.rgb / most;
  gl_Position = placed(lattice);
  gl_PointSize = pointSize;
}`,
  fragment: `${HEAD}
uniform float strength;
uniform float ownColor;
uniform bool isPoint;
in vec3 own;
out vec4 color;
void main() {
  float light = dot(own, vec3(0.299, 0.587, 0.114));
  vec3 contrast = light > 0.5 ? own * 0.25 : own * 0.4 + 0.6;
  float alpha = strength;
  vec3 drawn = mix(contrast, own * 0.75 + 0.25, ownColor);
  if (isPoint) {
    float radius = length(gl_PointCoord - 0.5) * 2.0;
    alpha *= 1.0 - smoothstep(0.8, 1.0, radius);
    drawn = mix(vec3(1.0), vec3(0.05), smoothstep(0.45, 0.6, radius));
    drawn = mix(drawn, own, 1.0 - smoothstep(0.3, 0.45, radius));
  }
  color = vec4(drawn, 1.0) * alpha;
}`,
};

/** Edges of a width: for each a strip of two triangles along it. */
export const EDGES = {
  vertex: `${HEAD}${PLACED}
uniform vec2 size;
uniform float width;
layout(location = 0) in vec4 ends;
void main() {
  vec2 from = placed(ends.xy).xy * size * 0.5, to = placed(ends.zw).xy * size * 0.5;
  vec2 along = to - from;
  along = along / max(length(along), 1e-6);
  vec2 aside = vec2(-along.y, along.x) * (float(gl_VertexID & 1) - 0.5) * width;
  // A little longer than it is, so that edges meet without a gap.
  vec2 at = (gl_VertexID < 2 ? from - along * width * 0.3 : to + along * width * 0.3) + aside;
  gl_Position = vec4(at * 2.0 / size, 0.0, 1.0);
}`,
  fragment: `${HEAD}
uniform vec3 tint;
out vec4 color;
void main() {
  color = vec4(tint, 1.0);
}`,
};

/** The picture's rectangle, with what is chosen to be seen in it. */
export const PICTURE = {
  vertex: `${HEAD}
uniform vec4 place;
uniform vec2 size;
out vec2 at;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  at = corner;
  gl_Position = vec4(corner * size * place.xy + place.zw, 0.0, 1.0);
}`,
  fragment: `${HEAD}${HEAT}
uniform sampler2D mesh;
uniform sampler2D original;
uniform sampler2D density;
uniform sampler2D weights;
uniform vec2 size;
uniform vec4 ground;
uniform bool brush;
uniform int layer;
uniform float errorScale;
uniform float pixelSide;
in vec2 at;
out vec4 color;

vec3 flattened(vec4 sampled) {
  vec2 square = floor(at * size / 8.0);
  float shade = mod(square.x + square.y, 2.0) < 1.0 ? 0.45 : 0.55;
  return mix(mix(vec3(shade), ground.rgb, ground.a), sampled.rgb, sampled.a);
}

// Enlarged pixels are even and their edges a screen pixel wide, whatever the zoom; where it is a
// whole number nothing is mixed.
vec2 enlarged() {
  if (pixelSide < 1.0) return at;
  vec2 place = at * size - 0.5;
  vec2 nearest = floor(place);
  return (nearest + 0.5 + clamp((place - nearest - 0.5) * pixelSide + 0.5, 0.0, 1.0)) / size;
}

void main() {
  vec3 shown;
  vec2 from = enlarged();
  if (layer == 0) shown = flattened(texture(mesh, from));
  else if (layer == 1) shown = flattened(texture(original, from));
  else if (layer == 2) shown = heat(texture(density, from).r);
  else if (layer == 3) {
    vec4 difference = abs(texture(mesh, from) - texture(original, from));
    float error = max(max(difference.r, difference.g), max(difference.b, difference.a));
    shown = heat(error * 255.0 / errorScale);
  } else if (layer == 5) shown = flattened(vec4(0.0));
  else shown = vec3(0.055, 0.065, 0.09);
  // Single pixels get an edge when they are large.
  vec2 within = fract(at * size);
  float edge = 1.0 / pixelSide;
  if (pixelSide >= 14.0 && layer != 4 && (within.x < edge || within.y < edge)) {
    shown = mix(shown, vec3(dot(shown, vec3(0.333)) > 0.5 ? 0.0 : 1.0), 0.12);
  }
  if (brush) {
    // What matters more is tinted, what matters less is veiled.
    float weight = texture(weights, at).r - 96.0 / 255.0;
    if (weight > 0.0) shown = mix(shown, vec3(1.0, 0.45, 0.25), min(0.6, weight * 1.1));
    else shown = mix(shown, vec3(0.09, 0.12, 0.2), min(0.75, -weight * 2.2));
  }
  color = vec4(shown, 1.0);
}`,
};

/** The relief, lit from the upper left. */
export const RELIEF = {
  vertex: `${HEAD}
uniform mat4 camera;
uniform vec3 middle;
uniform float stretch;
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 linearColor;
out vec3 ground;
out vec3 tint;
void main() {
  vec3 raised = (position - middle) * vec3(1.0, 1.0, stretch);
  ground = raised;
  tint = linearColor.rgb;
  gl_Position = camera * vec4(raised, 1.0);
}`,
  fragment: `${HEAD}
in vec3 ground;
in vec3 tint;
out vec4 color;
vec3 encoded(vec3 linear) {
  return mix(1.055 * pow(max(linear, 0.0), vec3(1.0 / 2.4)) - 0.055, 12.92 * linear, lessThan(linear, vec3(0.0031308)));
}
void main() {
  vec3 normal = normalize(cross(dFdx(ground), dFdy(ground)));
  if (normal.z < 0.0) normal = -normal;
  float light = 0.62 + 0.55 * max(dot(normal, normalize(vec3(-0.5, 0.6, 0.75))), 0.0);
  color = vec4(encoded(tint) * light, 1.0);
}`,
};
