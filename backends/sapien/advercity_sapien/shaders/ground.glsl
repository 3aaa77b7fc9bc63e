// Water and snow on surfaces; needs atmosphere.glsl, surface.glsl, texture.glsl, samplerPuddles and
// samplerShelter.

// A threshold at which noise of a standard deviation leaves a share above it, as far as the pixel's
// footprint lets the noise be seen; what it does not show blends. (Logistic for the normal law.)
float patchy(float share, float noise, float sigma, float kept, float soft) {
  const float LOGISTIC = 1.702;
  float likely = clamp(share, 1e-3, 1.0 - 1e-3);
  float at = sigma / LOGISTIC * log(likely / (1.0 - likely));
  float lost = sigma * sigma * (1.0 - kept * kept);
  return 1.0 / (1.0 + exp(-LOGISTIC * (kept * noise + at) / sqrt(lost + soft * soft)));
}

// Between blades, leaves and crumbs water lies in drops.
bool holdsFilm(int kind) {
  return !(kind >= GRASS && kind <= CROPS) && kind != BARK && kind != LEAVES;
}

bool isRoad(int kind) { return kind == ASPHALT || kind == MARKING; }

// Share of a pixel under standing water: hollows of a fixed field, which the LiDAR reads as well,
// filled up to a level.
float standingWater(int kind, vec3 p, vec3 n, float footprint) {
  const float TEXEL = 0.75, SIZE = 512.0, SIGMA = 0.2, SOFT = 0.02, WAVELENGTH = 6.0;
  float level = parameter(0).z;
  if (level < -0.5 || !isRoad(kind) || n.z < 0.9) return 0.0;
  float share = kept(WAVELENGTH, footprint);
  float height = textureLod(samplerPuddles, (p.xy / TEXEL + 0.5) / SIZE, 0.0).r;
  float soft = sqrt(SIGMA * SIGMA * (1.0 - share * share) + SOFT * SOFT);
  height = 0.5 + (height - 0.5) * share;
  return 1.0 / (1.0 + exp(1.702 * (height - level) / soft));
}

// Normal of standing water in rain: rings as wide as a hand.
vec3 rippled(vec3 p, float footprint) {
  const float WAVELENGTH = 0.04;
  float slope = parameter(0).w * kept(WAVELENGTH, footprint);
  if (slope <= 0.0) return vec3(0.0, 0.0, 1.0);
  int salt = 200 + 2 * int(parameter(16).w);
  vec2 q = p.xy / WAVELENGTH;
  return normalize(vec3(slope * 2.0 * vec2(noise(q, salt), noise(q, salt + 1)), 1.0));
}

// Share of falling snow that reaches a place, under trees and roofs less.
float exposure(vec3 p) {
  const float ABOVE = 0.4, ASIDE = 0.7;
  vec4 map = parameter(17);
  float sum = 0.0;
  for (int i = 0; i < 5; ++i) {
    vec2 off = i == 0 ? vec2(0.0) : ASIDE * vec2(i % 2 == 0 ? 1.0 : -1.0, i > 2 ? 1.0 : -1.0);
    vec2 top = textureLod(samplerShelter, (p.xy + off - map.xy) * map.zw, 0.0).rg;
    sum += p.z < top.x - ABOVE ? 1.0 - top.y : 1.0;
  }
  return sum / 5.0;
}

// Share of a pixel under lying snow. It stays on what faces up; roads are driven free in ruts.
float snowCover(int kind, bool snowless, vec3 p, vec3 n, float footprint) {
  const float ON_ROAD = 0.005, ELSEWHERE = 0.002, SIGMA = 0.2, SOFT = 0.04;
  float depth = parameter(16).x;
  float upward = clamp((n.z - 0.35) / 0.4, 0.0, 1.0);
  if (depth <= 0.0 || snowless || upward <= 0.0) return 0.0;
  float cover = upward * (1.0 - exp(-depth / (isRoad(kind) ? ON_ROAD : ELSEWHERE))) * exposure(p);
  if (kind == 0) return cover;
  if (isRoad(kind)) {
    float rut = smoothstep(0.1, 0.5, wear(p.xy, footprint));
    cover *= mix(parameter(16).y, parameter(16).z, rut);
  }
  float coarse = kept(1.7, footprint), fine = kept(0.4, footprint), finest = kept(0.1, footprint);
  float seen = 0.4 * coarse * noise(p.xy / 1.7, 91) + 0.35 * fine * noise(p.xy / 0.4, 92)
      + 0.2 * finest * noise(p.xy / 0.1, 93);
  float share = sqrt((0.16 * coarse + 0.1225 * fine + 0.04 * finest) / 0.3225);
  return patchy(cover, share > 0.0 ? seen / share : 0.0, SIGMA, share, SOFT);
}

// What a material looks like at a place, with what lies on it. A water film darkens what is rough
// and porous and puts a smooth coat on it (Ångström 1925; Lekner and Dorf 1988). What is smooth
// already, such as car paint, only beads.
Surface surface(vec3 albedo, float roughness, float metallic, int kind, bool snowless, vec3 p,
    vec3 normal, float footprint) {
  const float EXTERNAL = 0.0664, INTERNAL = 0.4746, INDEX_MATCHED = 0.85;
  const float FILMED = 0.15, STILL = 0.02;
  const vec3 SNOW = vec3(0.86, 0.88, 0.91);
  float porous = smoothstep(0.45, 0.6, roughness) * (1.0 - metallic);
  float puddle = wetness() > 0.0 ? standingWater(kind, p, normal, footprint) : 0.0;
  float wet = mix(wetness() * porous * mix(0.5, 1.0, max(normal.z, 0.0)), 1.0, puddle);
  vec3 soaked = INDEX_MATCHED * (1.0 - EXTERNAL) * (1.0 - INTERNAL) * albedo
      / (1.0 - albedo * INTERNAL);
  float film = holdsFilm(kind) ? smoothstep(0.3, 1.0, wet) : 0.0;
  float waves = parameter(0).w;
  waves = STILL + 1.41 * waves * (1.0 - kept(0.04, footprint));

  Surface s;
  s.albedo = mix(albedo, soaked, wet) * (1.0 - metallic);
  s.alpha = max(mix(mix(roughness * roughness, FILMED, film), waves, puddle), 0.02);
  s.coat = (1.0 - metallic) * mix(1.0, film, porous);
  s.index = mix(1.5, WATER, porous);
  s.metal = albedo * metallic;
  s.normal = puddle > 0.5 ? rippled(p, footprint) : normal;

  float snow = snowCover(kind, snowless, p, normal, footprint);
  s.albedo = mix(s.albedo, SNOW, snow);
  s.alpha = mix(s.alpha, 1.0, snow);
  s.coat *= 1.0 - snow;
  s.metal *= 1.0 - snow;
  return s;
}
