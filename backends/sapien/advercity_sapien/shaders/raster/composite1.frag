#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerSeen;
layout(set = 0, binding = 1) uniform sampler2D samplerReflex;
layout(set = 0, binding = 2) uniform sampler2D samplerGlow;

// Radiance with reflexes and the glow of lamps, and depth.
layout(location = 0) out vec4 outShaded;
// Levels of the light that fog deflects.
layout(location = 1) out vec4 outLevels;

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../deflection.glsl"
#include "./pixel_samples.glsl"
#include "./spread_light.glsl"
#include "./dither.glsl"

// How alike two depths are, for what changes slowly with them, 0 to 1.
float likeness(float one, float other) {
  const float TOLERANCE = 0.25;
  float inverse = 1.0 / (one > 0.0 ? one : FAR_M);
  float difference = abs(1.0 / (other > 0.0 ? other : FAR_M) - inverse);
  return max(1.0 - difference / (TOLERANCE * inverse), 0.0);
}

// What level surfaces mirror, averaged over the dithered pixels of about the same depth.
vec3 filterReflexes(vec3 own, ivec2 pixel, float depth) {
  ivec2 first = ditherBlock(pixel, pixelCount());
  vec3 sum = vec3(0.0);
  float weight = 0.0;
  for (int i = 0; i < DITHER * DITHER; ++i) {
    ivec2 texel = first + ivec2(i % DITHER, i / DITHER);
    float alike = likeness(depth, texelFetch(samplerSeen, texel, 0).a);
    sum += alike * texelFetch(samplerReflex, texel, 0).rgb;
    weight += alike;
  }
  return weight > 0.0 ? sum / weight : own;
}

// The glow of lamps, averaged likewise over pixels of which it was computed; over all of them around a
// thing so thin that none shows it.
vec3 filterGlow(ivec2 pixel, float depth) {
  const float LEAST = 1e-4;
  ivec2 first = ditherBlock((pixel + 1) / 2, glowCount());
  vec3 sum = vec3(0.0);
  float weight = 0.0;
  for (int i = 0; i < DITHER * DITHER; ++i) {
    ivec2 texel = min(first + ivec2(i % DITHER, i / DITHER), glowCount() - 1);
    // The nearer the more: even weights would make squares of halos.
    vec2 near = max(1.0 - abs(vec2(glowPixel(texel) - pixel)) / float(DITHER), 0.0);
    vec4 glow = texelFetch(samplerGlow, texel, 0);
    float alike = likeness(depth, abs(glow.a)) + LEAST;
    sum += near.x * near.y * alike * glow.rgb;
    weight += near.x * near.y * alike;
  }
  return sum / weight;
}

// Quadratic B-spline at a distance off its middle.
float splineWeight(float off) {
  float beyond = 1.5 - abs(off);
  return abs(off) < 0.5 ? 0.75 - off * off : 0.5 * beyond * beyond;
}

// Light around a texel of a level but the first, weighed by a quadratic B-spline, so that it matters
// little where between two texels a small thing is. Beyond the edges it goes on as it is within.
vec4 lightAround(int level, ivec2 at) {
  int ratio = levelRatio(level);
  ivec2 origin = deflectedOrigin(), size = levelSize(1);
  ivec2 from = max((at - 1) * ratio, ivec2(0)), to = min((at + 2) * ratio, size);
  float perTexel = 1.0 / float(ratio), weightSum = 0.0;
  vec2 middle = (vec2(at) + 0.5) - 0.5 * perTexel;
  vec4 sum = vec4(0.0);
  for (int y = from.y; y < to.y; ++y) {
    float weightY = splineWeight(float(y) * perTexel - middle.y);
    for (int x = from.x; x < to.x; ++x) {
      float weight = weightY * splineWeight(float(x) * perTexel - middle.x);
      weightSum += weight;
      sum += weight * texelFetch(samplerGlow, origin + ivec2(x, y), 0);
    }
  }
  return sum / weightSum;
}

// The texel of the levels at a place of their image.
vec4 levelTexel(ivec2 texel) {
  ivec2 size = levelSize(1), at = texel;
  if (all(lessThan(at, size))) {
    vec4 light = texelFetch(samplerGlow, deflectedOrigin() + at, 0);
    return lightOfLevel(light, 1, (vec2(at) + 0.5) / vec2(size));
  }
  at.y -= size.y;
  if (at.y < 0 || at.y >= levelSize(2).y) return vec4(0.0);
  for (int level = 2, last = lastLevel(); level <= last && at.x >= 0; ++level) {
    size = levelSize(level);
    if (all(lessThan(at, size))) {
      return lightOfLevel(lightAround(level, at), level, (vec2(at) + 0.5) / vec2(size));
    }
    at.x -= size.x;
  }
  return vec4(0.0);
}

void main() {
  ivec2 texel = wholeNumber(floor(gl_FragCoord.xy)), pixel = pixelOf(texel);
  vec4 firstOfGlow = texelFetch(samplerGlow, ivec2(0), 0);
  outLevels = vec4(0.0);
  if (spreadsLight(firstOfGlow)) outLevels = levelTexel(texel);
  vec4 seen = texelFetch(samplerSeen, texel, 0);
  outShaded = seen;
  if (seen.a == NO_LIGHT) return;
  vec4 reflex = texelFetch(samplerReflex, texel, 0);
  if (reflex.a > 0.0) outShaded.rgb += filterReflexes(reflex.rgb, pixel, seen.a);
  if (firstOfGlow.a != 0.0) outShaded.rgb += filterGlow(pixel, seen.a);
}
