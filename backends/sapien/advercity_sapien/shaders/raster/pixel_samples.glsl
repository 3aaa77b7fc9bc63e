// Images may have two by two samples in each pixel. Surfaces are drawn at all of them. Light is computed
// at the first, the middle of the pixel, and at others if no adjacent middle shows the same surface
// (after Chajdas et al. 2011, Subpixel reconstruction antialiasing).
//
// So images of surfaces have the samples of a pixel side by side; those of light have the first samples
// of all pixels side by side, to their right the second ones, and so on. Needs the camera's buffer.

// Depth in images of light where none was computed.
const float NO_LIGHT = -1.0;

// In images of surfaces added to the pattern of a material that falling snow does not stay on.
const int SNOWLESS = 64;

// Samples of a pixel along an axis, from the principal point: it is half a sample off the middle for two.
int samplesPerAxis() {
  return 1 + wholeNumber(round(abs(cameraBuffer.projectionMatrix[2][0]) * cameraBuffer.width));
}

ivec2 sampleCount() { return wholeNumber(vec2(cameraBuffer.width, cameraBuffer.height)); }

// Texels divided by the samples of a pixel, one or two, and the remainder: LLVM divides whole numbers one
// pixel after another.
ivec2 perPixel(ivec2 texels) { return texels >> (samplesPerAxis() - 1); }
ivec2 withinPixel(ivec2 texels) { return texels & (samplesPerAxis() - 1); }

ivec2 pixelCount() { return perPixel(sampleCount()); }

// Which sample of its pixel a texel in images of light is, and its pixel.
ivec2 sampleOf(ivec2 lightTexel) { return ivec2(greaterThanEqual(lightTexel, pixelCount())); }
ivec2 pixelOf(ivec2 lightTexel) { return lightTexel - sampleOf(lightTexel) * pixelCount(); }

// Texel in images of surfaces, of a texel in images of light, and the inverse.
ivec2 surfaceTexel(ivec2 lightTexel) {
  return pixelOf(lightTexel) * samplesPerAxis() + sampleOf(lightTexel);
}

ivec2 lightTexel(ivec2 surfaceTexel) {
  return perPixel(surfaceTexel) + withinPixel(surfaceTexel) * pixelCount();
}

// Place in the camera's image of a texel in images of surfaces.
vec2 imagePlace(ivec2 surfaceTexel) { return (vec2(surfaceTexel) + 0.5) / vec2(sampleCount()); }

// Pixels from the corner to a place in the camera's image; middles are at halves.
vec2 pixelPlace(vec2 place) {
  return (place * vec2(sampleCount()) - 0.5) / float(samplesPerAxis()) + 0.5;
}

// Pixel at a place in the camera's image, or the nearest one.
ivec2 pixelAt(vec2 place) {
  return wholeNumber(clamp(floor(pixelPlace(place)), vec2(0.0), vec2(pixelCount() - 1)));
}

// Pixels of which the glow of lamps is computed, along both axes, and the pixel of one of them.
ivec2 glowCount() { return (pixelCount() + 1) / 2; }
ivec2 glowPixel(ivec2 glowTexel) { return 2 * glowTexel; }

// Angle that a pixel covers in the middle of the image, in radians.
float pixelAngle() {
  return 2.0 * float(samplesPerAxis()) / (cameraBuffer.projectionMatrix[0][0] * cameraBuffer.width);
}
