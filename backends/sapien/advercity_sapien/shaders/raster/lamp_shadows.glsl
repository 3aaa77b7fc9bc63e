// Shadows of lamps, by the maps of how far their light gets (lamp_shadows.py).
// Needs lamps.glsl and samplerLampReach.

// Axes of a lamp's map: to the right, upwards, and ahead.
mat3 lampAxes(Lamp l) {
  vec3 right = l.kind == LAMP_STREET ? vec3(1.0, 0.0, 0.0) : rightAxis(l.facing);
  return mat3(right, cross(right, l.facing), l.facing);
}

// Texels of a lamp's map for each metre across at one metre ahead.
vec2 texelsPerSlope(Lamp l) {
  return isBeam(l) ? 0.5 * vec2(BEAM_REACH_TEXELS) / BEAM_REACH_HALF_SIZE
      : 0.5 * vec2(LENS_REACH_TEXELS) / LENS_REACH_HALF_SIZE;
}

// Place of a point, in a lamp's axes, in its map: in texels from the middle of the first.
vec2 reachPlace(Lamp l, vec3 point) {
  vec2 last = vec2(isBeam(l) ? BEAM_REACH_TEXELS : LENS_REACH_TEXELS) - 1.0;
  vec2 at = 0.5 * last + point.xy * texelsPerSlope(l) * (1.0 / max(point.z, 1e-3));
  return clamp(at, vec2(0.0), last);
}

// First texel of a lamp's map.
ivec2 reachCell(Lamp l) {
  return REACH_CELL * ivec2(l.number % REACH_CELLS_PER_ROW, l.number / REACH_CELLS_PER_ROW);
}

float airVisibility(Lamp l, vec3 away) {
  vec3 point = away * lampAxes(l);
  ivec2 texel = wholeNumber(floor(reachPlace(l, point) + 0.5));
  return step(point.z, texelFetch(samplerLampReach, reachCell(l) + texel, 0).x);
}

// Fraction of a lamp that is visible from a surface: four texels, each compared with where its own
// ray meets the plane of the surface, so that slanting surfaces do not shade themselves. Level ones
// need no such care: the ground is in no map.
float lampVisibility(Lamp l, vec3 position, vec3 normal) {
  const float NEAR = 0.3, RELATIVE = 0.02;  // closer before a surface than this, nothing shades it
  mat3 axes = lampAxes(l);
  vec3 point = (position - l.position) * axes, across = normal * axes;
  ivec2 texels = isBeam(l) ? BEAM_REACH_TEXELS : LENS_REACH_TEXELS;
  vec2 place = reachPlace(l, point);
  ivec2 first = min(wholeNumber(floor(place)), texels - 2);
  vec2 part = place - vec2(first);
  vec2 size = vec2(textureSize(samplerLampReach, 0));
  vec4 reach = textureGather(samplerLampReach, vec2(reachCell(l) + first + 1) / size);
  // Rays of the four texels, in the order of the gathered ones: 1 ahead.
  vec2 perTexel = 1.0 / texelsPerSlope(l);
  vec2 low = (vec2(first) + 0.5 * vec2(1 - texels)) * perTexel, high = low + perTexel;
  vec4 slope = across.x * vec4(low.x, high.x, high.x, low.x)
      + across.y * vec4(high.y, high.y, low.y, low.y) + across.z;
  float plane = dot(across, point);
  vec4 expected = vec4(point.z);
  if (normal.z < 0.7) {
    expected = mix(expected, min(plane / slope, expected), greaterThan(slope * plane, vec4(0.0)));
  }
  vec4 lit = step(expected * (1.0 - RELATIVE) - NEAR, reach);
  return mix(mix(lit.w, lit.z, part.x), mix(lit.x, lit.y, part.x), part.y);
}
