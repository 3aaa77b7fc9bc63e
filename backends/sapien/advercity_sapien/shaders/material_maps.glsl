// Images of a material on a surface, without visible repetition and faded to their mean where they
// are finer than a pixel. Needs shader_constants.glsl, sampling.glsl, map_plane.glsl, mapTone (ratio
// of the albedo and, as alpha, of the roughness to their means, in the greatest of each) and mapRelief (x
// and y of the normal).

struct MapSample {
  vec4 tone;    // factors of the albedo and the roughness
  vec2 slope;   // x and y of the normal in the image's axes
};

// Bits of SAPIEN's mask of a material's textures.
const int HAS_TONE = 1, HAS_RELIEF = 4;
const MapSample NO_MAPS = MapSample(vec4(1.0), vec2(0.0));

// Where the images are sampled: around a coordinate, at a level of detail, `taps` times along the
// long axis of what a pixel sees, `stride` apart.
struct MapLookup {
  vec2 uv;
  float lod;
  int taps;
  vec2 stride;
  bool hasRelief;
  vec4 range;
};

MapSample sampleImages(MapLookup look) {
  MapSample sum = MapSample(vec4(0.0), vec2(0.0));
  vec2 uv = look.uv - 0.5 * float(look.taps - 1) * look.stride;
  for (int i = 0; i < look.taps; ++i) {
    sum.tone += textureLod(mapTone, uv, look.lod);
    if (look.hasRelief) sum.slope += textureLod(mapRelief, uv, look.lod).xy;
    uv += look.stride;
  }
  return MapSample(look.range * sum.tone / float(look.taps), sum.slope / float(look.taps));
}

void addCopy(inout MapSample sum, ivec2 corner, float weight, MapLookup look) {
  const float UNSEEN = 0.02;
  if (weight < UNSEEN) return;
  look.uv += vec2(hashUnit(ivec3(corner, 301)), hashUnit(ivec3(corner, 302)));
  MapSample found = sampleImages(look);
  sum.tone += weight * (found.tone - 1.0);
  sum.slope += weight * found.slope;
}

// Copies of the images at random places around the corners of a lattice of triangles, blended so
// that their variance stays that of one image (Heitz and Neyret 2018).
MapSample blendCopies(MapLookup look) {
  const float TRIANGLES = 1.6;   // per side of an image
  const float SHARPNESS = 5.0;
  const mat2 SKEW = mat2(1.0, 0.0, -0.57735027, 1.15470054);
  vec2 skewed = SKEW * (look.uv * TRIANGLES);
  ivec2 cell = wholeNumber(floor(skewed));
  vec2 f = skewed - vec2(cell);
  bool upper = f.x + f.y > 1.0;
  vec3 weights = upper ? vec3(f.x + f.y - 1.0, 1.0 - f.y, 1.0 - f.x) : vec3(1.0 - f.x - f.y, f.y, f.x);
  weights = pow(weights, vec3(SHARPNESS));
  weights /= weights.x + weights.y + weights.z;
  MapSample sum = MapSample(vec4(0.0), vec2(0.0));
  addCopy(sum, cell + (upper ? 1 : 0), weights.x, look);
  addCopy(sum, cell + (upper ? ivec2(1, 0) : ivec2(0, 1)), weights.y, look);
  addCopy(sum, cell + (upper ? ivec2(0, 1) : ivec2(1, 0)), weights.z, look);
  float contrast = inversesqrt(dot(weights, weights));
  return MapSample(max(1.0 + contrast * sum.tone, 0.0), contrast * sum.slope);
}

// Images of a surface of normal n, seen along `ray`.
//   width: of the images, metres
//   range: greatest ratios of colour and roughness to their means
//   pixelWidth: of a pixel at the distance of the surface, metres
MapSample sampleMaps(int kind, float width, vec4 range, bool hasRelief, MapPlane plane, vec3 n,
    vec3 ray, float pixelWidth) {
  const float TAPS = 4.0;
  vec2 size = vec2(textureSize(mapTone, 0));
  float across = abs(dot(ray, n)), stretch = min(1.0 / max(across, 0.02), 4.0 * TAPS);
  float fine = max(1.0, stretch / TAPS);
  MapLookup look;
  look.lod = log2(pixelWidth * fine / width * size.x);
  if (look.lod > log2(min(size.x, size.y)) - 1.0) return NO_MAPS;
  // Rows of images run downwards.
  vec2 scale = vec2(1.0, -size.x / size.y) / width;
  look.hasRelief = hasRelief;
  look.range = range;
  look.uv = plane.at * scale;
  look.taps = int(ceil(stretch / fine - 0.5));
  look.stride = ray * plane.axes / sqrt(1.0 - across * across + 1e-6)
      * scale * (pixelWidth * stretch / float(look.taps));
  return isUnordered(kind) ? blendCopies(look) : sampleImages(look);
}

// Normal of a surface with the relief of its images.
vec3 reliefNormal(vec3 n, MapPlane plane, vec2 slope) {
  if (slope == vec2(0.0)) return n;
  return normalize(plane.axes * slope + n * sqrt(max(1.0 - dot(slope, slope), 0.01)));
}
