#version 450

layout(set = 0, binding = 0) uniform sampler2D samplerSeen;
layout(set = 0, binding = 1) uniform sampler2D samplerGlow;

layout(location = 0) in vec2 inUV;
layout(location = 0) out vec4 outRadiance;

#include "./dither.glsl"

// The glow of lamps, of all dithered pixels that look as far into the air, about.
vec3 smoothGlow(float depth) {
  const float ALIKE = 0.25, FAR = 3000.0;
  ivec2 first = dithered(gl_FragCoord.xy, textureSize(samplerGlow, 0));
  float inverse = 1.0 / (depth > 0.0 ? depth : FAR);
  vec3 sum = vec3(0.0);
  float weight = 0.0;
  for (int i = 0; i < DITHER * DITHER; ++i) {
    ivec2 texel = first + ivec2(i % DITHER, i / DITHER);
    float there = texelFetch(samplerSeen, texel, 0).a;
    float off = abs(1.0 / (there > 0.0 ? there : FAR) - inverse);
    float alike = max(1.0 - off / (ALIKE * inverse), 0.0);
    sum += alike * texelFetch(samplerGlow, texel, 0).rgb;
    weight += alike;
  }
  return sum / weight;
}

void main() {
  vec4 seen = texture(samplerSeen, inUV);
  vec3 glow = texture(samplerGlow, inUV).rgb;
  if (glow != vec3(0.0)) glow = smoothGlow(seen.a);
  outRadiance = vec4(seen.rgb + glow, seen.a);
}
