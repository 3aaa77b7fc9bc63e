#version 450

// Means of pixels of an image whose light was computed at their middles: each pixel is seen at three by
// three samples, from edge to edge, and a sample has the light of the middles around that show its surface
// (after Chajdas et al. 2011, Subpixel reconstruction antialiasing).

#define CAMERA_SET 1
// SAPIEN makes no camera without the scene's buffer.
#define SCENE_SET 0
#define NO_SHADOWS
#include "../raster/interface.glsl"

layout(set = 2, binding = 0) uniform sampler2D samplerEdge;
layout(set = 2, binding = 1) uniform sampler2D samplerPaned;
layout(set = 2, binding = 2) uniform sampler2D samplerMiddles;

// Radiance of the pixels of a tile, side by side in the first quarter of the image.
layout(location = 0) out vec4 outSmooth;

#include "../whole_numbers.glsl"

// A surface behind panes, if there are any.
struct SeenSurface {
  float number;
  // 1/m, 0 for the sky; it changes evenly along planes in the image.
  float inverseDepth;
  vec3 normal;
  bool hasPane;
};

SeenSurface surfaceAt(ivec2 texel) {
  vec4 found = texelFetch(samplerEdge, texel, 0);
  float height = sqrt(max(1.0 - dot(found.xy, found.xy), 0.0));
  return SeenSurface(found.w, found.z != 0.0 ? 1.0 / abs(found.z) : 0.0,
      vec3(found.xy, found.z < 0.0 ? -height : height), texelFetch(samplerPaned, texel, 0).x > 0.0);
}

ivec2 sampleCount() { return wholeNumber(vec2(cameraBuffer.width, cameraBuffer.height)); }

// First pixel of the tile in the image: by the principal point, which is the middle of the image.
ivec2 tileOrigin() {
  vec2 principal = 0.5 * vec2(sampleCount()) * (1.0 - cameraBuffer.projectionMatrix[2].xy);
  return wholeNumber(round(0.5 * (vec2(textureSize(samplerMiddles, 0)) - 0.5 - principal)));
}

// Offset of one of the three by three samples around the middle of a pixel.
ivec2 offsetOf(int number) { return ivec2(number % 3, number / 3) - 1; }

// Whether the samples around the middle of a pixel show one surface without a fold; beyond the image's
// first row and column there are none.
bool isOneSurface(SeenSurface around[9], ivec2 middleTexel) {
  const float FOLD = 5e-4;  // relative; a car's body bends by a tenth of it
  SeenSurface middle = around[4];
  for (int i = 0; i < 4; ++i) {
    SeenSurface one = around[i], other = around[8 - i];
    if (one.number != middle.number || other.number != middle.number) return false;
    if (one.hasPane != middle.hasPane || other.hasPane != middle.hasPane) return false;
    if (any(lessThan(middleTexel, abs(offsetOf(i))))) continue;
    float bend = abs(one.inverseDepth + other.inverseDepth - 2.0 * middle.inverseDepth);
    if (bend > FOLD * middle.inverseDepth) return false;
  }
  return true;
}

// How likely one sample has the light of another, from 0 to 1.
float similarity(SeenSurface one, SeenSurface other) {
  const float CLOSE = 2e-3, FAR = 0.1;  // relative differences of depth
  const float OTHER_PANE = 1e-3;
  if (one.number != other.number) return 0.0;
  float difference = abs(one.inverseDepth - other.inverseDepth) / max(one.inverseDepth, 1e-6);
  if (difference > FAR) return 0.0;
  float facing = max(dot(one.normal, other.normal), 0.05);
  return facing * facing * CLOSE / (CLOSE + difference)
      * (one.hasPane == other.hasPane ? 1.0 : OTHER_PANE);
}

// Light of a sample times its weight, and the weight: 0 if no middle around shows its surface. What is thin
// may be between all of them for some pixels along it, so the next nearest ones are asked then.
vec4 lightAt(ivec2 texel, SeenSurface seen, ivec2 origin, ivec2 pixels) {
  const int WIDEST = 4;
  ivec2 odd = texel & 1;
  vec4 sum = vec4(0.0);
  for (int beyond = 0; beyond < WIDEST && sum.a == 0.0; ++beyond) {
    ivec2 first = (texel >> 1) - beyond, last = (texel >> 1) + odd + beyond;
    for (int y = first.y; y <= last.y; ++y) {
      bool isEnd = y == first.y || y == last.y;
      for (int x = first.x; x <= last.x; x += isEnd || beyond == 0 ? 1 : last.x - first.x) {
        ivec2 pixel = ivec2(x, y);
        if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, pixels))) continue;
        float likely = similarity(seen, surfaceAt(2 * pixel));
        if (likely > 0.0) sum += likely * vec4(texelFetch(samplerMiddles, origin + pixel, 0).rgb, 1.0);
      }
    }
  }
  return sum / max(sum.a, 1e-12);
}

void main() {
  ivec2 pixel = wholeNumber(floor(gl_FragCoord.xy)), pixels = sampleCount() >> 1;
  if (any(greaterThanEqual(pixel, pixels))) discard;
  ivec2 origin = tileOrigin(), middle = 2 * pixel, last = sampleCount() - 1;
  outSmooth = texelFetch(samplerMiddles, origin + pixel, 0);
  SeenSurface around[9];
  for (int i = 0; i < 9; ++i) around[i] = surfaceAt(clamp(middle + offsetOf(i), ivec2(0), last));
  if (isOneSurface(around, middle)) return;
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 9; ++i) {
    ivec2 offset = offsetOf(i);
    // The pixel's area by the trapezoidal rule: its edges are half.
    float weight = (offset.x == 0 ? 0.5 : 0.25) * (offset.y == 0 ? 0.5 : 0.25);
    sum += weight * lightAt(clamp(middle + offset, ivec2(0), last), around[i], origin, pixels);
  }
  outSmooth.rgb = sum.rgb / sum.a;
}
