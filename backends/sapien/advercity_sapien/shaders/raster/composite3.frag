#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerShaded;
layout(set = 0, binding = 1) uniform sampler2D samplerFacing;
layout(set = 0, binding = 2) uniform sampler2D samplerDepthEmission;
layout(set = 0, binding = 3) uniform sampler2D samplerPane;
layout(set = 0, binding = 4) uniform sampler2D samplerGlow;
layout(set = 0, binding = 5) uniform sampler2D samplerLevels;
layout(set = 0, binding = 6) uniform sampler2D samplerSpread;
layout(set = 0, binding = 7) uniform sampler2D samplerTable;

// Radiance and depth of pixels: the mean of a pixel's samples, and the depth at its middle.
layout(location = 0) out vec4 outRadiance;

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../shader_table.glsl"
#include "../deflection.glsl"
#include "./pixel_samples.glsl"
#include "./spread_light.glsl"
#include "./seen_surfaces.glsl"

// Offset of one of the three by three samples around the middle of a pixel.
ivec2 offsetOf(int number) { return ivec2(number % 3, number / 3) - 1; }

float paneDepth(ivec2 texel) { return abs(texelFetch(samplerPane, texel, 0).z); }

// Whether the samples around the middle of a pixel show one surface without a fold; beyond the image's
// first row and column there are none.
bool isOneSurface(SeenSurface around[9], ivec2 middleTexel) {
  const float FOLD = 5e-4;  // relative; a car's body bends by a tenth of it
  SeenSurface middle = around[4];
  for (int i = 0; i < 4; ++i) {
    SeenSurface one = around[i], other = around[8 - i];
    if (one.number != middle.number || other.number != middle.number) return false;
    if (any(lessThan(middleTexel, abs(offsetOf(i))))) continue;
    float bend = abs(one.inverseDepth + other.inverseDepth - 2.0 * middle.inverseDepth);
    if (bend > FOLD * middle.inverseDepth) return false;
  }
  return true;
}

// Radiance of a sample: its own, or that of the adjacent middles by how likely they have the same.
vec3 radianceAt(ivec2 texel, SeenSurface seen) {
  vec4 own = texelFetch(samplerShaded, lightTexel(texel), 0);
  if (own.a != NO_LIGHT) return own.rgb;
  const float OTHER_PANE = 1e-3;
  vec3 normal = texelFetch(samplerFacing, texel, 0).xyz, sum = vec3(0.0);
  bool hasPane = paneDepth(texel) > 0.0;
  float weight = 0.0;
  for (int i = 0; i < 4; ++i) {
    ivec2 middle = adjacentMiddle(texel, i);
    float facing = max(dot(normal, texelFetch(samplerFacing, middle, 0).xyz), 0.05);
    float likely = facing * facing * similarity(seen, surfaceAt(middle));
    if ((paneDepth(middle) > 0.0) != hasPane) likely *= OTHER_PANE;
    sum += likely * texelFetch(samplerShaded, lightTexel(middle), 0).rgb;
    weight += likely;
  }
  return sum / weight;
}

// Radiance of a pixel that is seen at more than one of its samples.
vec3 pixelRadiance(ivec2 pixel) {
  vec3 middleRadiance = texelFetch(samplerShaded, pixel, 0).rgb;
  if (samplesPerAxis() == 1) return middleRadiance;
  ivec2 middle = surfaceTexel(pixel), last = sampleCount() - 1;
  SeenSurface around[9];
  int panes = 0;
  for (int i = 0; i < 9; ++i) {
    ivec2 texel = clamp(middle + offsetOf(i), ivec2(0), last);
    around[i] = surfaceAt(texel);
    panes += int(paneDepth(texel) > 0.0);
  }
  if (panes % 9 == 0 && isOneSurface(around, middle)) return middleRadiance;
  vec3 sum = vec3(0.0);
  for (int i = 0; i < 9; ++i) {
    ivec2 offset = offsetOf(i);
    // The pixel's area by the trapezoidal rule: its edges are half.
    float weight = (offset.x == 0 ? 0.5 : 0.25) * (offset.y == 0 ? 0.5 : 0.25);
    sum += weight * radianceAt(clamp(middle + offset, ivec2(0), last), around[i]);
  }
  return sum;
}

// Weights of the four texels around a place in a level, in texels, and the first of them.
vec4 texelWeights(vec2 at, out ivec2 first) {
  vec2 corner = floor(at - 0.5), part = at - 0.5 - corner, rest = 1.0 - part;
  first = wholeNumber(corner);
  return vec4(rest.x * rest.y, part.x * rest.y, rest.x * part.y, part.x * part.y);
}

// Light of surfaces around that fog deflects into a pixel. What is deflected beyond the surface of the pixel
// does not get through it; seen at some distance from where it comes from, it is deflected anywhere before it.
vec3 lightFromAround(ivec2 pixel, float depth) {
  ivec2 first, last = levelSize(1) - 1;
  vec4 spread = vec4(0.0), weights = texelWeights((vec2(pixel) + 0.5) / 2.0, first);
  for (int i = 0; i < 4; ++i) {
    ivec2 texel = clamp(first + ivec2(i & 1, i >> 1), ivec2(0), last);
    spread += weights[i] * texelFetch(samplerLevels, texel, 0);
  }
  last = levelSize(2) - 1;
  weights = texelWeights((vec2(pixel) + 0.5) / 4.0, first);
  for (int i = 0; i < 4; ++i) {
    ivec2 texel = clamp(first + ivec2(i & 1, i >> 1), ivec2(0), last);
    spread += weights[i] * texelFetch(samplerSpread, texel, 0);
  }
  float sum = spread.r + spread.g + spread.b;
  float before = (1.0 - DROPLET_WIDE_FRACTION) * extinction() * (depth > 0.0 ? depth : FAR_M);
  return spread.rgb * min(before * sum / max(spread.a, 1e-9), 1.0);
}

void main() {
  ivec2 pixel = wholeNumber(floor(gl_FragCoord.xy));
  if (any(greaterThanEqual(pixel, pixelCount()))) discard;
  outRadiance = vec4(pixelRadiance(pixel), texelFetch(samplerShaded, pixel, 0).a);
  if (spreadsLight(texelFetch(samplerGlow, ivec2(0), 0))) outRadiance.rgb += lightFromAround(pixel, outRadiance.a);
}
