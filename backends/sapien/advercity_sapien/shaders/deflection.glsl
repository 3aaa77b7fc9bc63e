// By how little fog deflects light: scattering.py of the core has the formulas. Needs shader_constants.glsl.

// Light that the narrow lobe deflects farther than the rest would come from where nothing is known of it.
const float MOST_DEFLECTED = 0.97;

// Spread, in radians, of light that the narrow lobe deflects on a path of an optical depth above 0.
float forwardSpread(float depth) {
  return DROPLET_NARROW_SCALE * depth / (depth < 1e-3 ? depth : 1.0 - exp(-depth));
}

// Density of deflections by an angle, without the factor that their part of a circle gives.
float deflectionDensity(float angle, float spread) {
  float spreads = angle / spread, root = sqrt(1.0 + spreads * spreads);
  return 1.0 / (spread * root * (root + spreads));
}
