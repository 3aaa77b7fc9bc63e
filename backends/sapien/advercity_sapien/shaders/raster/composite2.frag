#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerLevels;
layout(set = 0, binding = 1) uniform sampler2D samplerGlow;

// All levels but the first of the light that fog deflects, in texels of the second.
layout(location = 0) out vec4 outSpread;

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../deflection.glsl"
#include "./pixel_samples.glsl"
#include "./spread_light.glsl"

// Light at a place of a level, in its texels, by a cubic B-spline: straight lines between texels would show
// around what is small and bright.
vec4 smoothLight(int level, vec2 at) {
  vec2 corner = floor(at - 0.5), f = at - 0.5 - corner, g = 1.0 - f;
  vec2 weights[4] = vec2[](g * g * g / 6.0, (4.0 - 6.0 * f * f + 3.0 * f * f * f) / 6.0,
      (4.0 - 6.0 * g * g + 3.0 * g * g * g) / 6.0, f * f * f / 6.0);
  ivec2 first = wholeNumber(corner) - 1, origin = levelOrigin(level), last = levelSize(level) - 1;
  vec4 sum = vec4(0.0);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 4; ++x) {
      ivec2 texel = clamp(first + ivec2(x, y), ivec2(0), last);
      sum += weights[x].x * weights[y].y * texelFetch(samplerLevels, origin + texel, 0);
    }
  }
  return sum;
}

void main() {
  ivec2 texel = wholeNumber(floor(gl_FragCoord.xy));
  if (any(greaterThanEqual(texel, levelSize(2))) || !spreadsLight(texelFetch(samplerGlow, ivec2(0), 0))) discard;
  outSpread = vec4(0.0);
  for (int level = 2, last = lastLevel(); level <= last; ++level) {
    outSpread += smoothLight(level, (vec2(texel) + 0.5) * (2.0 / float(levelRatio(level))));
  }
}
