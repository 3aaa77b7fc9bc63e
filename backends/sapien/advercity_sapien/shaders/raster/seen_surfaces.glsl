// Which samples of an image show the same surface. Needs pixel_samples.glsl and samplerDepthEmission.

// A surface behind panes, if there are any.
struct SeenSurface {
  float number;
  // 1/m, 0 for the sky; it changes evenly along planes in the image.
  float inverseDepth;
};

SeenSurface surfaceAt(ivec2 texel) {
  vec4 found = texelFetch(samplerDepthEmission, texel, 0);
  return SeenSurface(found.w, found.x > 0.0 ? 1.0 / found.x : 0.0);
}

// How likely one sample has the light of another, from 0 to 1, by their surfaces.
float similarity(SeenSurface one, SeenSurface other) {
  const float CLOSE = 2e-3, FAR = 0.1;  // relative differences of depth
  if (one.number != other.number) return 0.0;
  float difference = abs(one.inverseDepth - other.inverseDepth) / max(one.inverseDepth, 1e-6);
  return difference > FAR ? 0.0 : CLOSE / (CLOSE + difference);
}

// Middle of one of the up to four pixels around a sample: among the samples.
ivec2 adjacentMiddle(ivec2 texel, int number) {
  ivec2 side = ivec2(number & 1, number >> 1) * withinPixel(texel);
  return min(perPixel(texel) + side, pixelCount() - 1) * samplesPerAxis();
}
