// Detail of materials: by what their albedo differs from its mean, as a factor around 1.
// It hangs on world position alone, so it never repeats in sight. Every term has the mean 0 and
// fades where its wavelength comes close to the footprint of a pixel, so that nothing shimmers.
// `kind` is a `Texture` of the world's materials. Needs atmosphere.glsl and samplerWear.

const int ASPHALT = 1, PAVING = 2, GRASS = 3, SOIL = 4, CROPS = 5, BRICK = 6, PLASTER = 7;
const int BARK = 8, LEAVES = 9, TILES = 10, WOOD = 11, STONE = 12, MARKING = 13;

uint mixed(uint h) {
  h = (h ^ (h >> 16u)) * 0x7feb352du;
  h = (h ^ (h >> 15u)) * 0x846ca68bu;
  return h ^ (h >> 16u);
}

// Uniform in [-1, 1), one for each cell of a grid.
float chance(ivec3 cell) {
  uint h = mixed(uint(cell.x) * 0x9e3779b1u ^ uint(cell.y) * 0x85ebca6bu ^ uint(cell.z) * 0xc2b2ae35u);
  return float(h >> 8u) / 8388608.0 - 1.0;
}

float chance(vec2 cell, int salt) { return chance(ivec3(ivec2(cell), salt)); }

// Smooth noise with a lattice of 1, mean 0.
float noise(vec2 p, int salt) {
  vec2 cell = floor(p), f = p - cell;
  f = f * f * (3.0 - 2.0 * f);
  ivec2 i = ivec2(cell);
  float low = mix(chance(ivec3(i, salt)), chance(ivec3(i + ivec2(1, 0), salt)), f.x);
  float high = mix(chance(ivec3(i + ivec2(0, 1), salt)), chance(ivec3(i + ivec2(1, 1), salt)), f.x);
  return mix(low, high, f.y);
}

float noise(vec3 p, int salt) {
  float layer = floor(p.z), f = p.z - layer;
  int at = int(layer) * 64 + salt;
  return mix(noise(p.xy, at), noise(p.xy, at + 64), f * f * (3.0 - 2.0 * f));
}

// How much is left of a pattern of a wavelength in a pixel as wide as `footprint`, metres.
float kept(float wavelength, float footprint) {
  return clamp(1.5 - 3.0 * footprint / wavelength, 0.0, 1.0);
}

float term(vec2 p, float wavelength, float footprint, int salt) {
  float share = kept(wavelength, footprint);
  return share > 0.0 ? share * noise(p / wavelength, salt) : 0.0;
}

float term(vec3 p, float wavelength, float footprint, int salt) {
  float share = kept(wavelength, footprint);
  return share > 0.0 ? share * noise(p / wavelength, salt) : 0.0;
}

// Joints between pieces of `size`, as wide as `width`: 1 in them, less their share, so mean 0.
float joints(vec2 p, vec2 size, float width, float footprint) {
  float share = kept(min(size.x, size.y), footprint);
  if (share <= 0.0) return 0.0;
  float soft = max(footprint, 0.25 * width);
  vec2 off = abs(fract(p / size) - 0.5) * size;
  vec2 edge = clamp((off - 0.5 * (size - width)) / soft + 0.5, 0.0, 1.0);
  vec2 mean = vec2(width) / size;
  return share * (edge.x + edge.y - edge.x * edge.y - (mean.x + mean.y - mean.x * mean.y));
}

// Tone of each piece of a bond.
float pieces(vec2 p, vec2 size, float footprint, int salt) {
  return kept(2.0 * min(size.x, size.y), footprint) * chance(floor(p / size), salt);
}

// Every other course is shifted by half a piece.
vec2 bonded(vec2 p, vec2 size) {
  return p + vec2(0.5 * size.x * mod(floor(p.y / size.y), 2.0), 0.0);
}

// Rectangles of newer asphalt, some to a hectare, mean 0.
float patches(vec2 p, float footprint) {
  const float CELL = 11.0, SHARE = 0.22;
  vec2 cell = floor(p / CELL);
  float share = kept(2.0, footprint);
  if (share <= 0.0) return 0.0;
  const float MEAN = SHARE * 3.0 * 1.8 / (CELL * CELL);
  if (0.5 + 0.5 * chance(cell, 71) > SHARE) return -share * MEAN;
  vec2 halfSize = 0.5 * vec2(3.0 + 1.6 * chance(cell, 72), 1.8 + 0.8 * chance(cell, 73));
  vec2 middle = (cell + 0.5) * CELL + vec2(chance(cell, 74), chance(cell, 75)) * 3.0;
  vec2 inside = clamp((halfSize - abs(p - middle)) / max(footprint, 0.02) + 0.5, 0.0, 1.0);
  return share * (inside.x * inside.y - MEAN);
}

// Where a slow noise passes zero, and another lets it.
float cracks(vec2 p, float footprint) {
  float share = kept(0.5, footprint);
  if (share <= 0.0) return 0.0;
  float allowed = smoothstep(0.15, 0.3, noise(p / 13.0, 81));
  if (allowed <= 0.0) return 0.0;
  vec2 bent = p + 0.25 * vec2(noise(p / 0.4, 82), noise(p / 0.4, 83));
  float away = abs(noise(bent / 3.7, 84)) * 3.7 * 0.6;
  float soft = max(footprint, 0.006);
  return share * allowed * clamp((0.012 - away) / soft + 0.5, 0.0, 1.0);
}

// Horizontal and upward coordinate on a surface, metres.
vec2 onSurface(vec3 p, vec3 n) {
  float level = length(n.xy);
  if (level < 0.3) return p.xy;
  return vec2(dot(p.xy, vec2(-n.y, n.x)) / level, p.z / level);
}

// Polished by tyres (up to 1) or stained by what drips between them (down to -1).
float wear(vec2 p, float footprint) {
  vec4 map = parameter(14);
  vec2 uv = (p - map.xy) * map.zw;
  if (any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) return 0.0;
  return kept(3.0, footprint) * (textureLod(samplerWear, uv, 0.0).r * (255.0 / 127.0) - 128.0 / 127.0);
}

vec3 tinted(float tone, float hue) {
  return vec3(1.0 + tone + hue, 1.0 + tone + 0.25 * hue, 1.0 + tone - 0.5 * hue);
}

vec3 detail(int kind, vec3 p, vec3 n, float footprint) {
  float f = footprint;
  vec2 q = p.xy;
  if (kind == ASPHALT) {
    float tone = 0.30 * term(q, 0.025, f, 1) + 0.10 * term(q, 0.11, f, 2)
        + 0.07 * term(q, 0.9, f, 3) + 0.10 * term(q, 4.3, f, 4) + 0.10 * term(q, 23.0, f, 5);
    tone += 0.16 * wear(q, f) * (0.75 + 0.25 * noise(q / 5.0, 6));
    tone -= 0.30 * patches(q, f) + 0.45 * cracks(q, f);
    return vec3(1.0 + tone);
  }
  if (kind == GRASS) {
    float tone = 0.40 * term(q, 0.035, f, 1) + 0.22 * term(q, 0.21, f, 2)
        + 0.16 * term(q, 1.3, f, 3) + 0.12 * term(q, 7.7, f, 4);
    float hue = 0.14 * term(q, 3.1, f, 5) + 0.22 * term(q, 31.0, f, 6);
    return tinted(tone, hue);
  }
  if (kind == SOIL) {
    float tone = 0.35 * term(q, 0.06, f, 1) + 0.25 * term(q, 0.33, f, 2)
        + 0.15 * term(q, 2.7, f, 3) + 0.12 * term(q, 19.0, f, 4);
    return vec3(1.0 + tone);
  }
  if (kind == CROPS) {
    float tone = 0.35 * term(p, 0.09, f, 1) + 0.25 * term(q, 0.45, f, 2)
        + 0.14 * term(q, 4.1, f, 3);
    float hue = 0.12 * term(q, 9.0, f, 4) + 0.14 * term(q, 37.0, f, 5);
    return tinted(tone, hue);
  }
  if (kind == LEAVES) {
    float tone = 0.55 * term(p, 0.13, f, 1) + 0.35 * term(p, 0.6, f, 2);
    float hue = 0.12 * term(p, 0.35, f, 3) + 0.30 * term(q, 6.0, f, 4);
    return tinted(tone, hue);
  }
  if (kind == BARK) {
    float tone = 0.55 * term(p * vec3(1.0, 1.0, 0.15), 0.05, f, 1) + 0.25 * term(p, 0.4, f, 2);
    return vec3(1.0 + tone);
  }
  vec2 uv = onSurface(p, n);
  if (kind == BRICK) {
    const vec2 SIZE = vec2(0.25, 0.075);
    vec2 b = bonded(uv, SIZE);
    float tone = 0.30 * pieces(b, SIZE, f, 1) + 0.12 * term(uv, 1.1, f, 2)
        + 0.12 * term(uv, 5.0, f, 3);
    return vec3(1.0 + tone) + vec3(0.25, 0.9, 1.1) * joints(b, SIZE, 0.012, f);
  }
  if (kind == PLASTER) {
    float tone = 0.08 * term(uv, 0.05, f, 1) + 0.07 * term(uv, 1.3, f, 2)
        + 0.10 * term(uv * vec2(1.0, 0.17), 0.35, f, 3) + 0.08 * term(uv, 5.1, f, 4);
    return tinted(tone, 0.03 * term(uv, 2.9, f, 5));
  }
  if (kind == TILES) {
    const vec2 SIZE = vec2(0.30, 0.36);
    vec2 b = bonded(uv, SIZE);
    float tone = 0.25 * pieces(b, SIZE, f, 1) + 0.12 * term(uv, 2.3, f, 2);
    float row = kept(SIZE.y, f) * (fract(uv.y / SIZE.y) - 0.5);
    tone += 0.45 * row - 0.5 * joints(b, SIZE, 0.03, f);
    return tinted(tone, -0.10 * term(uv, 6.0, f, 3));
  }
  if (kind == WOOD) {
    const vec2 SIZE = vec2(0.14, 2.4);
    float tone = 0.22 * pieces(uv, SIZE, f, 1) - 0.6 * joints(uv, SIZE, 0.01, f)
        + 0.25 * term(uv * vec2(1.0, 0.08), 0.02, f, 2);
    return vec3(1.0 + tone);
  }
  if (kind == PAVING) {
    bool upright = n.z < 0.5;
    vec2 size = upright ? vec2(4.0, 2.0) : vec2(1.5);
    float tone = 0.12 * term(uv, 0.03, f, 1) + 0.10 * term(uv, 0.7, f, 2)
        + 0.08 * term(uv, 6.1, f, 3) + 0.07 * pieces(uv, size, f, 4);
    if (upright) tone += 0.16 * term(uv * vec2(1.0, 0.12), 0.5, f, 5);
    return vec3(1.0 + tone - 0.45 * joints(uv, size, 0.02, f));
  }
  if (kind == STONE) {
    return vec3(1.0 + 0.25 * term(p, 0.04, f, 1) + 0.12 * term(p, 0.5, f, 2));
  }
  if (kind == MARKING) {
    float tone = 0.10 * term(q, 0.04, f, 1) + 0.10 * term(q, 0.35, f, 2) + 0.08 * term(q, 3.0, f, 3);
    return vec3(1.0 + tone);
  }
  return vec3(1.0);
}

// Width in metres of what a pixel sees, at a distance and an angle of incidence: between the
// short and the long axis of its ellipse.
float footprint(float pixelAngle, float distance, float cosine) {
  return pixelAngle * distance * pow(max(cosine, 0.02), -0.7);
}
