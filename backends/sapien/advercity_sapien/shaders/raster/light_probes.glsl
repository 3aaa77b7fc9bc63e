// Daylight near walls and trees relative to that in the open, as baked by light_probes.py.
// Needs shader_constants.glsl, shader_table.glsl, samplerProbeLight, samplerProbeFirst,
// samplerProbeSecond and samplerContact.

// Texel of one of several maps, which lie above each other in a texture.
vec4 probeTexel(sampler2D probes, vec2 at, int number, int count) {
  float rows = float(textureSize(probes, 0).y / count);
  float row = clamp(at.y * rows, 0.5, rows - 0.5) + float(number) * rows;
  return textureLod(probes, vec2(at.x, row / (rows * float(count))), 0.0);
}

vec4 texelOfLevel(sampler2D probes, vec2 at, int level) {
  return probeTexel(probes, at, level, PROBE_LEVELS);
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
  float height = position.z - texelOfLevel(samplerProbeLight, at, 0).a;
  return smoothstep(UNDER, OUTSIDE, contactRatio(at, height));
}

// Light of the probes around a point.
struct ProbeLight {
  vec3 ratio;      // of the mean over all directions to that in the open
  mat2x4 shape;    // moments that depend on direction, relative to that mean
  float contact;   // fraction that things on the ground leave
  float fraction;  // how much of all this counts: none beyond the map's edges
  vec2 at;         // place on the map
  float height;    // above the ground, metres
};

// Light before a surface of normal n, so that probes behind it count little.
ProbeLight probeLight(vec3 position, vec3 n) {
  const float FADE = 0.04;  // fraction of the map, at its edges
  vec4 map = probeMapExtent();
  vec2 at = (position.xy + PROBE_AWAY * n.xy - map.xy) * map.zw;
  vec2 inside = smoothstep(vec2(0.0), vec2(FADE), 0.5 - abs(at - 0.5));
  if (inside.x * inside.y <= 0.0) return ProbeLight(vec3(1.0), mat2x4(0.0), 1.0, 0.0, at, 0.0);
  vec4 low = texelOfLevel(samplerProbeLight, at, 0);
  float height = position.z - low.a;
  int level = 0;
  while (level < PROBE_LEVELS - 2 && height > PROBE_HEIGHTS[level + 1]) ++level;
  float part = clamp((height - PROBE_HEIGHTS[level])
      / (PROBE_HEIGHTS[level + 1] - PROBE_HEIGHTS[level]), 0.0, 1.0);
  vec3 light = mix(texelOfLevel(samplerProbeLight, at, level).rgb,
      texelOfLevel(samplerProbeLight, at, level + 1).rgb, part);
  mat2x4 shape = mat2x4(mix(texelOfLevel(samplerProbeFirst, at, level),
      texelOfLevel(samplerProbeFirst, at, level + 1), part),
      mix(texelOfLevel(samplerProbeSecond, at, level),
      texelOfLevel(samplerProbeSecond, at, level + 1), part));
  float contact = contactRatio((position.xy - map.xy) * map.zw, height);
  return ProbeLight(light, shape, contact, inside.x * inside.y, at, height);
}

// Irradiance on a surface of normal n by light of a shape, relative to the mean over all normals.
float relativeIrradiance(mat2x4 shape, vec3 n) {
  vec4 first = vec4(n, 3.0 * n.z * n.z - 1.0), second = vec4(n * n.yzx, n.x * n.x - n.y * n.y);
  float along = dot(shape[0], IRRADIANCE_FACTORS[0] * first)
      + dot(shape[1], IRRADIANCE_FACTORS[1] * second);
  return max(1.0 + along, PROBE_DARKEST);
}

// Ratio of the irradiance on a surface of normal n to that in the open.
vec3 irradianceRatio(ProbeLight probe, vec3 n) {
  const float SIDE_FRACTION = 0.35;  // of the light on a body's side, from the dark ground at it
  mat2x4 inTheOpen = mat2x4(probeOpenShape(0), probeOpenShape(1));
  vec3 ratio = probe.ratio * relativeIrradiance(probe.shape, n) / relativeIrradiance(inTheOpen, n);
  ratio *= mix(1.0, probe.contact, max(abs(n.z), SIDE_FRACTION));
  return mix(vec3(1.0), ratio, probe.fraction);
}
