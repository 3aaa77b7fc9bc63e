#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerSeen;
layout(set = 0, binding = 1) uniform sampler2D samplerGlow;

// Radiance with the glow, and depth.
layout(location = 0) out vec4 outShaded;

#include "../shader_constants.glsl"
#include "./pixel_samples.glsl"
#include "./dither.glsl"

// The glow of lamps, averaged over the dithered pixels of about the same depth.
vec3 filterGlow(vec3 own, float depth) {
  const float TOLERANCE = 0.25;
  ivec2 first = ditherBlock(ivec2(gl_FragCoord.xy));
  float inverse = 1.0 / (depth > 0.0 ? depth : FAR_M);
  vec3 sum = vec3(0.0);
  float weight = 0.0;
  for (int i = 0; i < DITHER * DITHER; ++i) {
    ivec2 texel = first + ivec2(i % DITHER, i / DITHER);
    float sampleDepth = texelFetch(samplerSeen, texel, 0).a;
    float difference = abs(1.0 / (sampleDepth > 0.0 ? sampleDepth : FAR_M) - inverse);
    float similarity = max(1.0 - difference / (TOLERANCE * inverse), 0.0);
    sum += similarity * texelFetch(samplerGlow, texel, 0).rgb;
    weight += similarity;
  }
  return weight > 0.0 ? sum / weight : own;
}

void main() {
  vec4 seen = texelFetch(samplerSeen, ivec2(gl_FragCoord.xy), 0);
  if (seen.a == NO_LIGHT) {
    outShaded = seen;
    return;
  }
  vec4 own = texelFetch(samplerGlow, ivec2(gl_FragCoord.xy), 0);
  vec3 glow = own == vec4(0.0) ? vec3(0.0) : filterGlow(own.rgb, seen.a);
  outShaded = vec4(seen.rgb + glow, seen.a);
}
