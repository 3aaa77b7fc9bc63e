// Quantities of few samples use others in each pixel of a pattern of four by four, so that the mean
// of any four by four pixels has sixteen times the samples. Needs pixel_samples.glsl.

const int DITHER = 4;

// Ordered-dither threshold of a pixel, each sixteenth of [0, 1) once (Bayer 1973).
float dither(vec2 pixel) {
  ivec2 p = wholeNumber(floor(pixel));
  ivec2 fine = p & 1, coarse = (p >> 1) & 1;
  int rank = 4 * (2 * (fine.x ^ fine.y) + fine.y) + 2 * (coarse.x ^ coarse.y) + coarse.y;
  return (float(rank) + 0.5) / 16.0;
}

// The same of a pattern of two by two, each quarter once. In a tent as wide as two patterns all weigh the
// same.
float coarseDither(ivec2 texel) {
  ivec2 p = texel & 1;
  return (float(2 * (p.x ^ p.y) + p.y) + 0.5) / 4.0;
}

// First texel of the block of the pattern's size around one of so many.
ivec2 ditherBlock(ivec2 texel, ivec2 count) {
  return clamp(texel - DITHER / 2, ivec2(0), max(count - DITHER, ivec2(0)));
}
