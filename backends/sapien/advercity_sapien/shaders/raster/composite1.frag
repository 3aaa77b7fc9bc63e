#version 450

layout(set = 0, binding = 0) uniform sampler2D samplerSeen;
layout(set = 0, binding = 1) uniform sampler2D samplerGlow;

layout(location = 0) in vec2 inUV;
layout(location = 0) out vec4 outRadiance;

#include "../shader_constants.glsl"
#include "./dither.glsl"

// The glow of lamps, averaged over the dithered pixels of about the same depth.
vec3 filterGlow(float depth) {
  const float TOLERANCE = 0.25;
  ivec2 first = ditherBlock(gl_FragCoord.xy, textureSize(samplerGlow, 0));
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
  return sum / weight;
}

void main() {
  vec4 seen = texture(samplerSeen, inUV);
  vec3 glow = texture(samplerGlow, inUV).rgb;
  if (glow != vec3(0.0)) glow = filterGlow(seen.a);
  outRadiance = vec4(seen.rgb + glow, seen.a);
}
