// Where a pixel samples a surface, how widely, and random numbers of its cells.

uint hashMix(uint h) {
  h = (h ^ (h >> 16u)) * 0x7feb352du;
  h = (h ^ (h >> 15u)) * 0x846ca68bu;
  return h ^ (h >> 16u);
}

// Pseudorandom bits of a cell of a grid, and a number in [-1, 1) of them.
uint hashCell(ivec3 cell) {
  return hashMix(uint(cell.x) * 0x9e3779b1u ^ uint(cell.y) * 0x85ebca6bu
      ^ uint(cell.z) * 0xc2b2ae35u);
}

float hashUnit(ivec3 cell) { return float(hashCell(cell) >> 8u) / 8388608.0 - 1.0; }

float hashUnit(vec2 cell, int salt) { return hashUnit(ivec3(wholeNumber(cell), salt)); }

// Contrast that a pattern of a wavelength retains in a pixel as wide as `footprint`, metres.
float retainedContrast(float wavelength, float footprint) {
  return clamp(1.5 - 3.0 * footprint / wavelength, 0.0, 1.0);
}

// Sine of the slope up to which a surface counts as level.
const float LEVEL = 0.3;

// Horizontal and upward coordinate on a surface, metres; x and y on level ones.
vec2 surfaceUv(vec3 p, vec3 n) {
  float level = length(n.xy);
  if (level < LEVEL) return p.xy;
  return vec2(dot(p.xy, vec2(-n.y, n.x)) / level, p.z / level);
}

// Width in metres of the area that a pixel sees, at a distance and a cosine of incidence: between
// the short and the long axis of its ellipse.
float footprint(float pixelAngle, float distance, float cosine) {
  return pixelAngle * distance * pow(max(cosine, 0.02), -0.7);
}
