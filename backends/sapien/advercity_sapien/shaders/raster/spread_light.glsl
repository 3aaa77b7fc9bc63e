// Light of lamp-lit surfaces that fog deflects by a little, spread in the image as far as it is deflected.
//
// Deflections on a path are an even mixture of Cauchy distributions, and so one of Gaussians of all widths.
// Levels of a pyramid of images represent ranges of widths: the first has pixels of twice the size, the others
// of 4, 16, 64 and 256 times. What is narrower stays in its pixel. All levels are made of all light of the image:
// what is thin and bright gives as much as what is wide and dim.
//
// Texels are light that is deflected, and last the sum of its colours times the optical depth of the narrow
// lobe that deflects it. Needs deflection.glsl, pixel_samples.glsl.

// Where a pixel is wide, hardly any light would be left for more.
int lastLevel() {
  float narrow = DROPLET_NARROW_SCALE / pixelAngle();
  return narrow < 4.0 ? 3 : narrow < 16.0 ? 4 : 5;
}

// Texels of the first level along the edge of one of another, as a power of two: LLVM divides one pixel after
// another.
int levelPower(int level) { return level == 1 ? 0 : 2 * level - 3; }
int levelRatio(int level) { return 1 << levelPower(level); }

// Standard deviation in pixels below which Gaussians are those of finer levels: the geometric mean of what
// becomes of a point in this level and in the one before, smoothed when they are made and when they are read.
float narrowestOf(int level) {
  if (level <= 2) return level == 1 ? 0.6 : 2.0;
  return 3.1 * float(levelRatio(level - 1));
}

// Fraction of deflected light whose Gaussians are narrower than so many pixels; `spread` in pixels, too.
// With the error function of Abramowitz and Stegun (7.1.25).
float fractionNarrower(float pixels, float spread) {
  float b = 0.70711 * spread / pixels, t = 1.0 / (1.0 + 0.47047 * b), bell = exp(-b * b);
  float complement = t * (0.3480242 + t * (-0.0958798 + 0.7478556 * t)) * bell;
  return complement + 0.5641896 * (1.0 - bell) / max(b, 1e-4);
}

// Spread in pixels at a place of the image, of what an optical depth deflects. Towards the edges a pixel
// covers less.
float spreadInPixels(vec2 place, float depth) {
  vec2 slope = (place * 2.0 - 1.0)
      / vec2(cameraBuffer.projectionMatrix[0][0], cameraBuffer.projectionMatrix[1][1]);
  float root = sqrt(1.0 + dot(slope, slope));
  return forwardSpread(depth) / pixelAngle() * root * sqrt(root);
}

// What a level has of a texel of light: all deflections of its widths.
vec4 lightOfLevel(vec4 texel, int level, vec2 place) {
  float sum = texel.r + texel.g + texel.b;
  if (sum <= 0.0) return vec4(0.0);
  float spread = spreadInPixels(place, max(texel.a / sum, 1e-3)), upTo = MOST_DEFLECTED;
  if (level < lastLevel()) upTo = min(upTo, fractionNarrower(narrowestOf(level + 1), spread));
  return texel * max(upTo - fractionNarrower(narrowestOf(level), spread), 0.0);
}

// Texels of a level, and where they begin in their image: the others are below the first, side by side.
ivec2 levelSize(int level) {
  ivec2 first = max(pixelCount() / 2, ivec2(1));
  return (first + levelRatio(level) - 1) >> levelPower(level);
}

ivec2 levelOrigin(int level) {
  if (level == 1) return ivec2(0);
  int x = 0;
  for (int i = 2; i < level; ++i) x += levelSize(i).x;
  return ivec2(x, levelSize(1).y);
}

// Where light in texels of the first level begins in the image of glow: to the right of it.
ivec2 deflectedOrigin() { return ivec2(glowCount().x, 0); }

// Whether any light is spread, by the first texel of the image of glow.
bool spreadsLight(vec4 firstOfGlow) { return firstOfGlow.a < 0.0; }
