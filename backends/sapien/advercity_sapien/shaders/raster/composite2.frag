#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerShaded;
layout(set = 0, binding = 1) uniform sampler2D samplerFacing;
layout(set = 0, binding = 2) uniform sampler2D samplerDepthEmission;
layout(set = 0, binding = 3) uniform sampler2D samplerPane;

// Radiance and depth of pixels: the mean of a pixel's samples, and the depth at its middle.
layout(location = 0) out vec4 outRadiance;

#include "../whole_numbers.glsl"
#include "./pixel_samples.glsl"
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

void main() {
  ivec2 pixel = wholeNumber(floor(gl_FragCoord.xy));
  if (any(greaterThanEqual(pixel, pixelCount()))) discard;
  outRadiance = texelFetch(samplerShaded, pixel, 0);
  if (samplesPerAxis() == 1) return;
  ivec2 middle = surfaceTexel(pixel), last = sampleCount() - 1;
  SeenSurface around[9];
  int panes = 0;
  for (int i = 0; i < 9; ++i) {
    ivec2 texel = clamp(middle + offsetOf(i), ivec2(0), last);
    around[i] = surfaceAt(texel);
    panes += int(paneDepth(texel) > 0.0);
  }
  if (panes % 9 == 0 && isOneSurface(around, middle)) return;
  vec3 sum = vec3(0.0);
  for (int i = 0; i < 9; ++i) {
    ivec2 offset = offsetOf(i);
    // The pixel's area by the trapezoidal rule: its edges are half.
    float weight = (offset.x == 0 ? 0.5 : 0.25) * (offset.y == 0 ? 0.5 : 0.25);
    sum += weight * radianceAt(clamp(middle + offset, ivec2(0), last), around[i]);
  }
  outRadiance.rgb = sum;
}
