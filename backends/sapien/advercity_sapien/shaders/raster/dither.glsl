// Quantities of few samples use others in each pixel of a pattern of four by four, so that the mean
// of any four by four pixels has sixteen times the samples. Needs pixel_samples.glsl.

const int DITHER = 4;

// Ordered-dither threshold of a pixel, each sixteenth of [0, 1) once (Bayer 1973).
float dither(vec2 pixel) {
  ivec2 p = ivec2(pixel);
  ivec2 fine = p & 1, coarse = (p >> 1) & 1;
  int rank = 4 * (2 * (fine.x ^ fine.y) + fine.y) + 2 * (coarse.x ^ coarse.y) + coarse.y;
  return (float(rank) + 0.5) / 16.0;
}

// First texel, in images of light, of the block of the pattern's size around a texel: of pixels' middles.
ivec2 ditherBlock(ivec2 texel) {
  ivec2 pixels = pixelCount();
  return clamp(texel % pixels - DITHER / 2, ivec2(0), pixels - DITHER);
}
