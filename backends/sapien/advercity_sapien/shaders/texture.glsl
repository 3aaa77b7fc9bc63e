// Detail of materials: the ratio of their albedo to its mean, a factor around 1.
// It depends on world position alone, so it never repeats in sight. Every octave has the mean 0 and
// fades where its wavelength comes close to the footprint of a pixel, so that nothing shimmers.
// `kind` is one of TEXTURE_.... Needs shader_constants.glsl, shader_table.glsl, sampling.glsl and
// samplerWear.

// Value noise with a lattice of 1, mean 0.
float noise(vec2 p, int salt) {
  vec2 cell = floor(p), f = p - cell;
  f = f * f * (3.0 - 2.0 * f);
  ivec2 i = wholeNumber(cell);
  ivec2 right = i + ivec2(1, 0), up = i + ivec2(0, 1), across = i + ivec2(1, 1);
  float low = mix(hashUnit(ivec3(i, salt)), hashUnit(ivec3(right, salt)), f.x);
  float high = mix(hashUnit(ivec3(up, salt)), hashUnit(ivec3(across, salt)), f.x);
  return mix(low, high, f.y);
}

float noise(vec3 p, int salt) {
  float layer = floor(p.z), f = p.z - layer;
  int at = wholeNumber(layer) * 64 + salt;
  return mix(noise(p.xy, at), noise(p.xy, at + 64), f * f * (3.0 - 2.0 * f));
}

// Roads run along the axes of many sites, and patterns that did so too would show their lattice.
const mat2 LATTICE_TURN = mat2(0.8, 0.6, -0.6, 0.8);

// Noise of a wavelength, as far as the footprint lets it be seen.
float octave(vec2 p, float wavelength, float footprint, int salt) {
  float fraction = retainedContrast(wavelength, footprint);
  return fraction > 0.0 ? fraction * noise(p / wavelength, salt) : 0.0;
}

float octave(vec3 p, float wavelength, float footprint, int salt) {
  float fraction = retainedContrast(wavelength, footprint);
  return fraction > 0.0 ? fraction * noise(p / wavelength, salt) : 0.0;
}

// How far leaves are off the corners of their lattice, over its cells.
const float LEAF_JITTER = 0.8;

// Random tone of each of the leaves in space: where a point is nearest to one of those strewn over a
// lattice, one in a cell. Beside the border to the next, both tones blend within the footprint.
float leafTones(vec3 p, float size, float footprint, int salt) {
  float fraction = retainedContrast(2.0 * size, footprint);
  if (fraction <= 0.0) return 0.0;
  vec3 q = p / size, cell = floor(q);
  ivec3 first = wholeNumber(cell), nearest = first, next = first;
  float nearestAway = 1e3, nextAway = 1e3;
  for (int i = 0; i < 8; ++i) {
    ivec3 corner = ivec3(i & 1, (i >> 1) & 1, i >> 2), at = first + corner;
    uint h = hashCell(ivec3(at.xy, at.z * 64 + salt));
    vec3 place = vec3(h & 1023u, (h >> 10u) & 1023u, (h >> 20u) & 1023u) / 1023.0;
    float away = length(vec3(corner) + LEAF_JITTER * (place - 0.5) - (q - cell));
    if (away < nearestAway) {
      nextAway = nearestAway;
      next = nearest;
      nearestAway = away;
      nearest = at;
    } else if (away < nextAway) {
      nextAway = away;
      next = at;
    }
  }
  float own = hashUnit(ivec3(nearest.xy, nearest.z * 64 + salt + 1));
  float other = hashUnit(ivec3(next.xy, next.z * 64 + salt + 1));
  float weight = clamp(0.5 + (nextAway - nearestAway) * size / max(2.0 * footprint, 1e-6), 0.5, 1.0);
  return fraction * mix(other, own, weight);
}

// Joints of a width between pieces of a size: 1 in them, less the fraction that they cover, so that
// the mean is 0.
float joints(vec2 p, vec2 size, float width, float footprint) {
  float fraction = retainedContrast(min(size.x, size.y), footprint);
  if (fraction <= 0.0) return 0.0;
  float soft = max(footprint, 0.25 * width);
  vec2 off = abs(fract(p / size) - 0.5) * size;
  vec2 edge = clamp((off - 0.5 * (size - width)) / soft + 0.5, 0.0, 1.0);
  vec2 mean = vec2(width) / size;
  return fraction * (edge.x + edge.y - edge.x * edge.y - (mean.x + mean.y - mean.x * mean.y));
}

// Random tone of each piece of a bond.
float pieceTones(vec2 p, vec2 size, float footprint, int salt) {
  return retainedContrast(2.0 * min(size.x, size.y), footprint) * hashUnit(floor(p / size), salt);
}

// Coordinate with every other course shifted by half a piece.
vec2 bondOffset(vec2 p, vec2 size) {
  return p + vec2(0.5 * size.x * mod(floor(p.y / size.y), 2.0), 0.0);
}

// Wear of a carriageway: how much more tyres polish it than the mean of its lane (up to 1), and what
// tyres, oil and the age of its paving make of its tone.
vec2 wear(vec2 p, float footprint) {
  vec4 map = wearMapExtent();
  vec2 uv = (p - map.xy) * map.zw;
  if (any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) return vec2(0.0);
  vec2 texel = textureLod(samplerWear, uv, 0.0).rg;
  return retainedContrast(3.0, footprint) * vec2(1.0, WEAR_TONE)
      * (texel * (255.0 / WEAR_STEPS) - NEUTRAL_WEAR / WEAR_STEPS);
}

// Worn paint, most where tyres go: 1 where asphalt shows, less the mean. It breaks off the tops of the
// aggregate's stones first; what is finer than the footprint blends, so that nothing sparkles.
float wornPaint(vec2 p, float polish, float footprint) {
  const float WORN = 0.13, BY_TYRES = 0.35, SOFT = 0.06, VARIANCE = 0.184;   // of noise()
  const float SLOPE = 1.702;   // of the logistic law that approximates the normal distribution
  float wavelength = 0.25, weight = 0.1, sum = 0.0, lost = SOFT * SOFT, all = 0.0;
  for (int i = 0; i < 4; ++i) {
    float kept = retainedContrast(wavelength, footprint);
    if (kept > 0.0) sum += weight * kept * noise(p / wavelength, 86 + i);
    lost += VARIANCE * weight * weight * (1.0 - kept * kept);
    all += VARIANCE * weight * weight;
    wavelength *= 0.36;
    weight *= 1.6;
    p = LATTICE_TURN * p;
  }
  float likely = clamp(WORN + BY_TYRES * polish, 0.02, 0.9);
  float at = sqrt(all + SOFT * SOFT) / SLOPE * log(likely / (1.0 - likely));
  return 1.0 / (1.0 + exp(-SLOPE * (sum + at) / sqrt(lost))) - WORN;
}

// Factor of a tone, and of a hue from green (negative) to yellow.
vec3 tint(float tone, float hue) {
  return vec3(1.0 + tone + hue, 1.0 + tone + 0.25 * hue, 1.0 + tone - 0.5 * hue);
}

// Hue of grass and leaves from fresh (negative) to withered: none is bluer than the mean.
const vec3 PLANT_HUE = vec3(1.0, 0.3, 0.5);

// Factor of a material's albedo at a point p of a surface of normal n. Images have all that is
// finer than MAPPED, except for joints of cast walls.
vec3 materialDetail(int kind, bool mapped, vec3 p, vec3 n, float footprint) {
  const float MAPPED = 0.3;
  float f = mapped ? max(footprint, MAPPED) : footprint;
  vec2 q = LATTICE_TURN * p.xy;
  if (kind == TEXTURE_ASPHALT) {
    float tone = 0.30 * octave(q, 0.025, f, 1) + 0.10 * octave(q, 0.11, f, 2)
        + 0.10 * octave(q, 0.9, f, 3) + 0.07 * octave(q, 4.3, f, 4) + 0.06 * octave(q, 23.0, f, 5);
    return vec3(1.0 + tone + wear(p.xy, f).y * (1.0 + 0.35 * noise(q / 3.0, 6)));
  }
  if (kind == TEXTURE_GRASS) {
    float tone = 0.35 * octave(q, 0.035, f, 1) + 0.28 * octave(q, 0.16, f, 2)
        + 0.32 * octave(q, 1.1, f, 3) + 0.24 * octave(q, 2.3, f, 4) + 0.13 * octave(q, 7.7, f, 7);
    float hue = 0.14 * octave(q, 1.3, f, 8) + 0.14 * octave(q, 3.1, f, 5)
        + 0.10 * octave(q, 11.0, f, 9) + 0.10 * octave(q, 31.0, f, 6);
    return vec3(1.0) + tone + hue * PLANT_HUE;
  }
  if (kind == TEXTURE_SOIL) {
    float tone = 0.35 * octave(q, 0.06, f, 1) + 0.25 * octave(q, 0.33, f, 2)
        + 0.15 * octave(q, 2.7, f, 3) + 0.12 * octave(q, 19.0, f, 4);
    return vec3(1.0 + tone);
  }
  if (kind == TEXTURE_CROPS && n.z < 0.6) {
    // Stalks from aside.
    float tone = 0.9 * octave(p * vec3(1.0, 1.0, 0.07), 0.03, f, 1)
        + 0.5 * octave(p * vec3(1.0, 1.0, 0.1), 0.12, f, 2) + 0.25 * octave(p, 0.7, f, 3);
    return tint(tone, 0.14 * octave(q, 2.9, f, 4));
  }
  if (kind == TEXTURE_CROPS) {
    float tone = 0.35 * octave(p, 0.09, f, 1) + 0.25 * octave(q, 0.45, f, 2)
        + 0.20 * octave(q, 1.6, f, 6) + 0.18 * octave(q, 4.1, f, 3);
    float hue = 0.12 * octave(q, 2.3, f, 7) + 0.14 * octave(q, 9.0, f, 4) + 0.14 * octave(q, 37.0, f, 5);
    return tint(tone, hue);
  }
  if (kind == TEXTURE_CROWN) {
    // Leaves and the gaps between them.
    float tone = 0.45 * leafTones(p, 0.11, f, 1) + 0.25 * leafTones(p, 0.3, f, 3) + 0.25 * octave(p, 1.1, f, 5);
    float hue = 0.12 * octave(p, 0.35, f, 3) + 0.20 * octave(q, 6.0, f, 4);
    return max(vec3(1.0) + tone + hue * PLANT_HUE, 0.0);
  }
  if (kind == TEXTURE_LEAVES) {
    float tone = 0.45 * leafTones(p, 0.11, f, 1) + 0.35 * octave(p, 0.6, f, 2);
    float hue = 0.12 * octave(p, 0.35, f, 3) + 0.20 * octave(q, 6.0, f, 4);
    return vec3(1.0) + tone + hue * PLANT_HUE;
  }
  if (kind == TEXTURE_BARK) {
    float tone = 0.55 * octave(p * vec3(1.0, 1.0, 0.15), 0.05, f, 1) + 0.25 * octave(p, 0.4, f, 2);
    return vec3(1.0 + tone);
  }
  vec2 uv = surfaceUv(p, n);
  if (kind == TEXTURE_BRICK) {
    const vec2 SIZE = vec2(0.25, 0.075);
    vec2 b = bondOffset(uv, SIZE);
    float tone = 0.30 * pieceTones(b, SIZE, f, 1) + 0.12 * octave(uv, 1.1, f, 2)
        + 0.12 * octave(uv, 5.0, f, 3);
    return vec3(1.0 + tone) + vec3(0.25, 0.9, 1.1) * joints(b, SIZE, 0.012, f);
  }
  if (kind == TEXTURE_PLASTER) {
    float tone = 0.08 * octave(uv, 0.05, f, 1) + 0.07 * octave(uv, 1.3, f, 2)
        + 0.10 * octave(uv * vec2(1.0, 0.17), 0.35, f, 3) + 0.08 * octave(uv, 5.1, f, 4);
    return tint(tone, 0.03 * octave(uv, 2.9, f, 5));
  }
  if (kind == TEXTURE_TILES) {
    const vec2 SIZE = vec2(0.30, 0.36);
    vec2 b = bondOffset(uv, SIZE);
    float tone = 0.25 * pieceTones(b, SIZE, f, 1) + 0.12 * octave(uv, 2.3, f, 2);
    float row = retainedContrast(SIZE.y, f) * (fract(uv.y / SIZE.y) - 0.5);
    tone += 0.45 * row - 0.5 * joints(b, SIZE, 0.03, f);
    return tint(tone, -0.10 * octave(uv, 6.0, f, 3));
  }
  if (kind == TEXTURE_WOOD) {
    const vec2 SIZE = vec2(0.14, 2.4);
    float tone = 0.22 * pieceTones(uv, SIZE, f, 1) - 0.6 * joints(uv, SIZE, 0.01, f)
        + 0.25 * octave(uv * vec2(1.0, 0.08), 0.02, f, 2);
    return vec3(1.0 + tone);
  }
  if (kind == TEXTURE_PAVING) {
    bool upright = n.z < 0.5;
    vec2 size = upright ? vec2(4.0, 2.0) : vec2(1.5);
    float tone = 0.12 * octave(uv, 0.03, f, 1) + 0.10 * octave(uv, 0.7, f, 2)
        + 0.08 * octave(uv, 6.1, f, 3) + 0.07 * pieceTones(uv, size, f, 4);
    if (upright) tone += 0.16 * octave(uv * vec2(1.0, 0.12), 0.5, f, 5);
    return vec3(1.0 + tone - 0.45 * joints(uv, size, 0.02, footprint));
  }
  if (kind == TEXTURE_SLABS) {
    const vec2 SIZE = vec2(0.5);
    float tone = 0.10 * octave(uv, 2.3, f, 1) + 0.08 * octave(uv, 9.1, f, 2);
    return vec3(1.0 + tone - 0.45 * joints(uv, SIZE, 0.01, f));
  }
  if (kind == TEXTURE_STONE) {
    return vec3(1.0 + 0.25 * octave(p, 0.04, f, 1) + 0.12 * octave(p, 0.5, f, 2));
  }
  if (kind == TEXTURE_MARKING) {
    float tone = 0.10 * octave(q, 0.04, f, 1) + 0.10 * octave(q, 0.35, f, 2)
        + 0.08 * octave(q, 3.0, f, 3);
    return vec3(1.0 + tone - 0.8 * wornPaint(q, wear(p.xy, f).x, f));
  }
  return vec3(1.0);
}
