// Daylight near walls and trees relative to that in the open, as baked by light_probes.py.
// Needs shader_constants.glsl, shader_table.glsl, samplerProbeLight, samplerProbeDirection
// and samplerContact.

// Texel of a level's map; levels lie above each other in the texture.
vec4 probeTexel(sampler2D probes, vec2 at, int level) {
  float rows = float(textureSize(probes, 0).y / PROBE_LEVELS);
  float row = clamp(at.y * rows, 0.5, rows - 0.5) + float(level) * rows;
  return textureLod(probes, vec2(at.x, row / (rows * float(PROBE_LEVELS))), 0.0);
}

// Fraction of the sky's light that things on the ground leave to a point at a height above it.
float contactRatio(vec2 at, float height) {
  const float LOW = 0.15, HIGH = 0.7;  // metres between which a body ends to darken itself
  return mix(textureLod(samplerContact, at, 0.0).r, 1.0, smoothstep(LOW, HIGH, height));
}

// Whether the ground at a position mirrors the sky: under a body it mirrors its dark underside, which
// no image shows.
float mirrorsSky(vec3 position) {
  const float UNDER = 0.1, OUTSIDE = 0.5;  // fractions of the sky's light
  vec4 map = probeMapExtent();
  vec2 at = (position.xy - map.xy) * map.zw;
  if (any(lessThan(at, vec2(0.0))) || any(greaterThan(at, vec2(1.0)))) return 1.0;
  float height = position.z - probeTexel(samplerProbeLight, at, 0).a;
  return smoothstep(UNDER, OUTSIDE, contactRatio(at, height));
}

// Ratio of the irradiance on a surface of normal n to that in the open.
vec3 probeRatio(vec3 position, vec3 n) {
  const float AWAY = 1.0;  // metres from the surface, so that probes behind it count little
  const float FADE = 0.04;  // fraction of the map, at its edges
  const float DARKEST = 0.05;
  const float SIDE_FRACTION = 0.35;  // of the light on a body's side, from the dark ground at it
  vec4 map = probeMapExtent();
  vec2 at = (position.xy + AWAY * n.xy - map.xy) * map.zw;
  vec2 inside = smoothstep(vec2(0.0), vec2(FADE), 0.5 - abs(at - 0.5));
  if (inside.x * inside.y <= 0.0) return vec3(1.0);
  vec4 low = probeTexel(samplerProbeLight, at, 0);
  float height = position.z + AWAY * n.z - low.a;
  int level = 0;
  while (level < PROBE_LEVELS - 2 && height > PROBE_HEIGHTS[level + 1]) ++level;
  float part = clamp((height - PROBE_HEIGHTS[level])
      / (PROBE_HEIGHTS[level + 1] - PROBE_HEIGHTS[level]), 0.0, 1.0);
  vec3 light = mix(probeTexel(samplerProbeLight, at, level).rgb,
      probeTexel(samplerProbeLight, at, level + 1).rgb, part);
  vec3 direction = mix(probeTexel(samplerProbeDirection, at, level).xyz,
      probeTexel(samplerProbeDirection, at, level + 1).xyz, part);
  light *= max(1.0 + 2.0 * dot(direction, n), DARKEST)
      / max(1.0 + 2.0 * dot(probeOpenDirection(), n), DARKEST);
  light *= mix(1.0, contactRatio((position.xy - map.xy) * map.zw, position.z - low.a),
      max(abs(n.z), SIDE_FRACTION));
  return mix(vec3(1.0), light, inside.x * inside.y);
}
