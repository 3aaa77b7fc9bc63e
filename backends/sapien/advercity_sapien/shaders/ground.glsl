// Water, ice and snow on surfaces; needs atmosphere.glsl, surface.glsl, texture.glsl, samplerPuddles and
// samplerShelter.

// Slope of the logistic law that approximates the normal distribution.
const float LOGISTIC = 1.702;
// Wavelength of the ripples that rain makes in puddles, metres.
const float RIPPLE_WAVELENGTH = 0.04;

// Coverage of a pixel by patches: the fraction of the noise above the threshold that a fraction of
// it exceeds. Noise finer than the pixel's footprint is not resolved and blends.
//   noise, sigma: its value here and standard deviation
//   kept: contrast that the footprint leaves; soft: width of the patches' edges
float coverFraction(float fraction, float noise, float sigma, float kept, float soft) {
  float likely = clamp(fraction, 1e-3, 1.0 - 1e-3);
  float at = sigma / LOGISTIC * log(likely / (1.0 - likely));
  float lost = sigma * sigma * (1.0 - kept * kept);
  return 1.0 / (1.0 + exp(-LOGISTIC * (kept * noise + at) / sqrt(lost + soft * soft)));
}

// Whether water makes a film; between blades, leaves and crumbs it stays in drops.
bool holdsFilm(int kind) {
  return !(kind >= TEXTURE_GRASS && kind <= TEXTURE_CROPS) && kind != TEXTURE_BARK
      && kind != TEXTURE_LEAVES && kind != TEXTURE_CROWN;
}

bool isRoad(int kind) { return kind == TEXTURE_ASPHALT || kind == TEXTURE_MARKING; }

// Fraction of a pixel under standing water: a fixed field of hollows, which the LiDAR reads as well,
// filled up to a level. SIGMA and WAVELENGTH are of that field.
float standingWater(int kind, vec3 p, vec3 n, float footprint) {
  const float SIGMA = 0.2, SOFT = 0.02, WAVELENGTH = 6.0;
  float level = puddleLevel();
  if (level <= NO_WATER_LEVEL || !isRoad(kind) || n.z < 0.9) return 0.0;
  float fraction = retainedContrast(WAVELENGTH, footprint);
  float height = textureLod(samplerPuddles, (p.xy / PUDDLE_TEXEL_M + 0.5) / PUDDLE_TEXELS, 0.0).r;
  float soft = sqrt(SIGMA * SIGMA * (1.0 - fraction * fraction) + SOFT * SOFT);
  height = 0.5 + (height - 0.5) * fraction;
  return 1.0 / (1.0 + exp(LOGISTIC * (height - level) / soft));
}

// Normal of standing water in rain; other ripples in every frame. Layers of cells have a drop each, around
// which a ring of waves has spread as far as its age lets it, and fades.
vec3 rippleNormal(vec3 p, float footprint) {
  const int LAYERS = 5;
  const float CELL = 0.13, LENGTH = 0.03, WIDTH = 0.022, REACH = 0.3, OFF_MIDDLE = 0.1, EDGE = 0.1;
  const float DEVIATION = 0.301;   // of the sum of all layers along one axis
  float slope = rippleSlope() * retainedContrast(RIPPLE_WAVELENGTH, footprint);
  if (slope <= 0.0) return vec3(0.0, 0.0, 1.0);
  vec2 sum = vec2(0.0);
  for (int i = 0; i < LAYERS; ++i) {
    vec2 q = p.xy / CELL + float(i) * vec2(0.37, 0.61);
    vec2 cell = floor(q), f = q - cell;
    int salt = 200 + 3 * (LAYERS * int(frameIndex()) + i);
    vec2 away = f - 0.5 - OFF_MIDDLE * vec2(hashUnit(cell, salt), hashUnit(cell, salt + 1));
    float age = 0.5 + 0.5 * hashUnit(cell, salt + 2);
    float far = length(away), behind = CELL * (far - REACH * age);
    vec2 rim = min(f, 1.0 - f) / EDGE;
    float wave = sin(2.0 * PI * behind / LENGTH) * exp(-behind * behind / (WIDTH * WIDTH));
    sum += wave * sqrt(1.0 - age) * min(min(rim.x, rim.y), 1.0) / max(far, 1e-3) * away;
  }
  return normalize(vec3(slope / DEVIATION * sum, 1.0));
}

// Fraction of falling snow that arrives at a point, less under trees and roofs. Five samples soften
// the map's texels.
float snowfallFraction(vec3 p) {
  const float CLEARANCE = 0.4, OFFSET = 0.7;
  vec4 map = shelterMapExtent();
  float sum = 0.0;
  for (int i = 0; i < 5; ++i) {
    vec2 off = i == 0 ? vec2(0.0) : OFFSET * vec2(i % 2 == 0 ? 1.0 : -1.0, i > 2 ? 1.0 : -1.0);
    vec2 top = textureLod(samplerShelter, (p.xy + off - map.xy) * map.zw, 0.0).rg;
    sum += p.z < top.x - CLEARANCE ? 1.0 - top.y : 1.0;
  }
  return sum / 5.0;
}

// Fraction of rain that arrives at a point, none under decks; samples let it in at their edges.
float rainfallFraction(vec3 p) {
  const float TOLERANCE = 0.05, OFFSET = 0.5;
  vec4 map = shelterMapExtent();
  float sum = 0.0;
  for (int i = 0; i < 5; ++i) {
    vec2 off = i == 0 ? vec2(0.0) : OFFSET * vec2(i % 2 == 0 ? 1.0 : -1.0, i > 2 ? 1.0 : -1.0);
    sum += p.z < textureLod(samplerShelter, (p.xy + off - map.xy) * map.zw, 0.0).b + TOLERANCE ? 0.0 : 1.0;
  }
  return sum / 5.0;
}

// Noise of ragged patches, as far as the footprint lets it be seen, and the fraction of its contrast
// that is. Octaves are turned against each other and bent, so that no lattice shows.
float patchNoise(vec2 p, float footprint, out float fraction) {
  const float GAIN = 0.75;
  const mat2 TURN = mat2(0.8, 0.6, -0.6, 0.8);
  float wavelength = 2.1, weight = 0.38, sum = 0.0, resolved = 0.0, all = 0.0;
  fraction = 0.0;
  vec2 q = p + 0.25 * vec2(noise(p / 1.3, 94), noise(p / 1.3, 95));
  for (int i = 0; i < 6; ++i) {
    float kept = retainedContrast(wavelength, footprint);
    q = TURN * q;
    if (kept > 0.0) sum += weight * kept * noise(q / wavelength, 91 + 8 * i);
    resolved += weight * weight * kept;
    all += weight * weight;
    wavelength *= 0.43;
    weight *= GAIN;
  }
  fraction = sqrt(resolved / all);
  return sum;
}

// Fraction of a pixel under lying snow. It stays on what faces up; traffic clears ruts of roads.
float snowCover(int kind, bool snowless, vec3 p, vec3 n, float footprint) {
  const float SIGMA = 0.2, SOFT = 0.04;
  float depth = snowDepth();
  float upward = clamp((n.z - 0.35) / 0.4, 0.0, 1.0);
  if (depth <= 0.0 || snowless || upward <= 0.0) return 0.0;
  float cover = upward * (1.0 - exp(-depth / (isRoad(kind) ? SNOW_DEPTH_ON_ROAD : SNOW_DEPTH)))
      * snowfallFraction(p);
  if (kind == TEXTURE_PLAIN) return cover;
  if (isRoad(kind)) {
    float rut = smoothstep(0.1, 0.5, wear(p.xy, footprint).x);
    cover *= mix(snowBetweenRuts(), snowInRuts(), rut);
  }
  float fraction;
  float resolved = patchNoise(p.xy, footprint, fraction);
  return coverFraction(cover, fraction > 0.0 ? resolved / fraction : 0.0, SIGMA, fraction, SOFT);
}

// Snow on a surface: on roads dirty where wheels go.
vec3 snowAlbedo(int kind, vec3 p, float footprint) {
  if (!isRoad(kind)) return CLEAN_SNOW;
  return mix(CLEAN_SNOW, DIRTY_SNOW, smoothstep(0.0, 0.5, wear(p.xy, footprint).x));
}

// Normal of snow that wind and wheels left uneven, on a surface of normal n.
vec3 snowNormal(vec3 p, vec3 n, float footprint) {
  const float WAVELENGTH = 0.45, SLOPE = 0.12;
  float slope = SLOPE * retainedContrast(WAVELENGTH, footprint);
  if (slope <= 0.0) return n;
  vec2 q = mat2(0.8, 0.6, -0.6, 0.8) * p.xy / WAVELENGTH;
  return normalize(n + slope * vec3(noise(q, 96), noise(q, 97), 0.0));
}

// Optical surface of a material at a point, with water and snow on it. A water film darkens rough,
// porous materials and coats them smoothly (Ångström 1925; Lekner and Dorf 1988). On smooth ones,
// such as car paint, water only beads. `relief` is the normal with what images add to it.
Surface buildSurface(vec3 albedo, float roughness, float metallic, int kind, bool snowless, vec3 p,
    vec3 normal, vec3 relief, float footprint) {
  // Blades and leaves face all ways: under ice, a lawn of them shines, but mirrors nothing.
  const float FILMED = 0.15, STILL = 0.02, GLAZED = 0.1, GLAZED_BLADES = 0.3;
  float porous = smoothstep(0.45, 0.6, roughness) * (1.0 - metallic);
  float rained = wetness() > 0.0 || iceCover() > 0.0 ? rainfallFraction(p) : 1.0;
  float puddle = wetness() > 0.0 ? rained * standingWater(kind, p, normal, footprint) : 0.0;
  float facing = mix(0.5, 1.0, max(normal.z, 0.0));
  float wet = mix(rained * wetness() * porous * facing, 1.0, puddle);
  // Clear ice envelops all that freezing rain reaches, blades and leaves, too.
  float ice = snowless ? 0.0 : rained * iceCover() * facing;
  wet = max(wet, ice * porous);
  vec3 soaked = INDEX_MATCHED_RATIO * (1.0 - WATER_EXTERNAL_REFLECTANCE)
      * (1.0 - WATER_INTERNAL_REFLECTANCE) * albedo / (1.0 - albedo * WATER_INTERNAL_REFLECTANCE);
  float film = max(holdsFilm(kind) ? smoothstep(0.3, 1.0, wet) : 0.0,
      holdsFilm(kind) ? ice : GLAZED_BLADES * ice);
  // Ripples finer than the pixel widen the lobe: alpha is sqrt(2) of the root mean square slope.
  float waves = rippleSlope() * (1.0 - ice);
  waves = STILL + 1.41 * waves * (1.0 - retainedContrast(RIPPLE_WAVELENGTH, footprint));

  Surface s;
  s.albedo = mix(albedo, soaked, wet) * (1.0 - metallic);
  float filmed = mix(FILMED, GLAZED, ice);
  s.alpha = max(mix(mix(roughness * roughness, filmed, film), waves, puddle), 0.02);
  s.coat = (1.0 - metallic) * mix(1.0, film, porous);
  s.index = mix(1.5, WATER_INDEX, porous);
  s.metal = albedo * metallic;
  s.through = kind == TEXTURE_LEAVES ? TRANSMITTED_BY_LEAVES : 0.0;
  // A film levels the relief that it covers, and snow hides it.
  s.normal = puddle > 0.5 && ice < 0.5 ? rippleNormal(p, footprint)
      : normalize(mix(relief, normal, 0.7 * film));

  float snow = snowCover(kind, snowless, p, normal, footprint);
  if (snow <= 0.0) return s;
  s.albedo = mix(s.albedo, snowAlbedo(kind, p, footprint), snow);
  s.alpha = mix(s.alpha, 1.0, snow);
  s.coat *= 1.0 - snow;
  s.metal *= 1.0 - snow;
  s.through *= 1.0 - snow;
  s.normal = normalize(mix(s.normal, snowNormal(p, normal, footprint), snow));
  return s;
}
