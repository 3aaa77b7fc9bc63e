#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerSeen;
layout(set = 0, binding = 1) uniform sampler2D samplerReflex;
layout(set = 0, binding = 2) uniform sampler2D samplerGlow;

// Radiance with reflexes and the glow of lamps, and depth.
layout(location = 0) out vec4 outShaded;

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "./pixel_samples.glsl"
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
    float alike = likeness(depth, texelFetch(samplerSeen, glowPixel(texel), 0).a) + LEAST;
    sum += near.x * near.y * alike * texelFetch(samplerGlow, texel, 0).rgb;
    weight += near.x * near.y * alike;
  }
  return sum / weight;
}

void main() {
  ivec2 texel = wholeNumber(floor(gl_FragCoord.xy)), pixel = texel % pixelCount();
  vec4 seen = texelFetch(samplerSeen, texel, 0);
  outShaded = seen;
  if (seen.a == NO_LIGHT) return;
  vec4 reflex = texelFetch(samplerReflex, texel, 0);
  if (reflex.a > 0.0) outShaded.rgb += filterReflexes(reflex.rgb, pixel, seen.a);
  if (texelFetch(samplerGlow, ivec2(0), 0).a > 0.0) outShaded.rgb += filterGlow(pixel, seen.a);
}
