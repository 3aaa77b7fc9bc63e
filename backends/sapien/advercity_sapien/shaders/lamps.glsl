// Lamps of streets, signals and vehicles, and their glow in fog.
// Needs shader_constants.glsl, shader_table.glsl, atmosphere.glsl, surface.glsl.

struct Lamp {
  vec3 position;
  int kind;
  vec3 facing;
  float minCosine; // cosine of the largest angle off it at which its glow is seen
  vec3 intensity;  // kcd, at the peak
  float range;     // metres, where its light ends
};

// Squared size, m²: nearer than its size a lamp is not a point. A fog lamp represents two.
float lampSizeSquared(Lamp l) { return l.kind == LAMP_FOG_BEAM ? 0.4 : 0.01; }

bool isBeam(Lamp l) { return l.kind == LAMP_LOW_BEAM || l.kind == LAMP_FOG_BEAM; }

Lamp fetchLamp(int i) {
  vec4 a = texelFetch(samplerTable, ivec2(i, LAMPS_ROW), 0);
  vec4 b = texelFetch(samplerTable, ivec2(i, LAMPS_ROW + 1), 0);
  vec4 c = texelFetch(samplerTable, ivec2(i, LAMPS_ROW + 2), 0);
  return Lamp(a.xyz, int(a.w), b.xyz, b.w, c.rgb, c.w);
}

// Numbers of four lamps of a list; -1 after the last.
ivec4 lampQuad(int row, int texel) {
  return ivec4(texelFetch(samplerTable, ivec2(texel % COLUMNS, row + texel / COLUMNS), 0));
}

// First texel of the list of a cell of the ground; -1 outside all cells.
int cellList(vec2 position) {
  vec4 grid = lampGrid();
  ivec2 cell = ivec2(floor((position - grid.xy) * grid.zw));
  if (any(lessThan(cell, ivec2(0))) || any(greaterThanEqual(cell, ivec2(GRID_CELLS)))) return -1;
  return (cell.y * GRID_CELLS + cell.x) * TEXELS_PER_CELL;
}

// First texel of the list of a horizontal direction.
int bearingList(vec2 away) {
  int bin = int((atan(away.y, away.x) / (2.0 * PI) + 0.5) * float(BEARINGS));
  return clamp(bin, 0, BEARINGS - 1) * TEXELS_PER_BEARING;
}

// First texel of the list of a tile of the image.
int tileList(vec2 uv) {
  ivec2 tile = clamp(ivec2(uv * vec2(TILES_WIDE, TILES_HIGH)), ivec2(0),
      ivec2(TILES_WIDE - 1, TILES_HIGH - 1));
  return (tile.y * TILES_WIDE + tile.x) * TEXELS_PER_TILE;
}

// Horizontal unit vector to the right of a lamp's axis.
vec3 rightAxis(vec3 facing) {
  return vec3(facing.y, -facing.x, 0.0) * inversesqrt(dot(facing.xy, facing.xy));
}

// Angles in degrees of a ray to the right of a beam's axis and above it, by the first terms of
// their arcs: cheaper than `LampBeam` in Python, and close enough. False for rays to the rear.
bool beamAngles(vec3 facing, vec3 ray, out float h, out float v) {
  float forward = dot(ray, facing);
  vec3 right = rightAxis(facing);
  float lateral = dot(ray, right) / forward, above = dot(ray, cross(right, facing));
  h = degrees(lateral / (1.0 + 0.28 * lateral * lateral));
  v = degrees(above * (1.0 + above * above / 6.0));
  return forward > 0.1;
}

// Intensity of a low beam or a front fog lamp along a ray, relative to its peak: `LampBeam` of the
// core's lamp_beams.py has the formula. What is below exp(-12) of it is dark.
float beamIntensity(LampBeam b, vec3 facing, vec3 ray) {
  float h, v;
  if (!beamAngles(facing, ray, h, v)) return 0.0;
  float x = v + b.cutoffDrop - clamp(b.kinkSlope * h, 0.0, b.kinkMax);
  float exponent = (h - b.peakRight) * (h - b.peakRight) / b.horizontalSquared;
  if (x < 0.0) exponent += (x + b.peakBelowCutoff) * (x + b.peakBelowCutoff) / b.belowSquared;
  if (v > 0.0) exponent += v * v / b.aboveSquared;
  if (exponent > 12.0) return 0.0;
  float dark = exp(clamp(x / b.cutoffSoftness, -40.0, 40.0));
  return (b.stray + (1.0 - b.stray) / (1.0 + dark)) * exp(-exponent);
}

// The same of a rear lamp, an indicator or a signal, by the cosine off its axis.
float lensFraction(float cosine) {
  float base = 1.0 + (1.0 - cosine) / LENS_FALLOFF;
  return (inversesqrt(sqrt(base)) / base - LENS_SIDE_FRACTION) / (1.0 - LENS_SIDE_FRACTION);
}

// The same of any lamp; street lamps are Lambertian. Each kind of beam has a call of its own, so that
// the compiler folds its constants.
float intensityFraction(Lamp l, vec3 ray) {
  if (l.kind == LAMP_LOW_BEAM) return beamIntensity(LOW_BEAM, l.facing, ray);
  if (l.kind == LAMP_FOG_BEAM) return beamIntensity(FRONT_FOG_BEAM, l.facing, ray);
  float cosine = max(dot(l.facing, ray), 0.0);
  return l.kind == LAMP_LENS ? lensFraction(cosine) : cosine;
}

// Fraction of a lamp's light that is kept at a distance, so that it ends softly with the lists.
float rangeFalloff(Lamp l, float distance) {
  float fraction = distance / l.range;
  fraction *= fraction;
  fraction = clamp(1.0 - fraction * fraction, 0.0, 1.0);
  return fraction * fraction;
}

// Radiance, sum of the colours, that is invisible against airlight and sky.
float negligibleRadiance() {
  return 5e-3 * (horizonAirlight().r + horizonAirlight().g + skyHarmonic(0).g);
}

// Droplets scatter half of the light by a few degrees only (the narrow lobe). It stays in a beam,
// and what an image point loses of it comes from the points around it.
float unscatteredTransmittance(float distance) {
  return transmittance(DROPLET_WIDE_FRACTION * distance);
}

// Ratio of the light that is seen of a lamp-lit surface, with what the narrow lobe returns from
// around, to the transmitted light; limited to what is still visible.
float forwardScatterGain(float distance) {
  return exp(min((1.0 - DROPLET_WIDE_FRACTION) * extinction() * distance, 8.0));
}

// Fraction of a lamp's light that fog leaves. Lamps that shine all around lose nothing: light that
// is scattered away from one point is scattered to it from others.
float beamTransmittance(Lamp l, float distance) {
  return l.kind == LAMP_STREET ? 1.0 : unscatteredTransmittance(distance);
}

// Irradiance on a surface by the light that fog scatters out of a beam, per klx that the beam's
// peak would give without fog and per fraction of it that is scattered. The table has flow and
// fluence by direction off the beam (fog_beams.py), interpolated here between four texels.
float scatteredIrradiance(Lamp l, vec3 ray, vec3 normal) {
  vec3 right = rightAxis(l.facing);
  vec3 up = cross(right, l.facing);
  float lateral = dot(ray, right), above = dot(ray, up);
  float ring = sqrt(acos(clamp(dot(ray, l.facing), -1.0, 1.0)) / PI) * float(FOG_BEAM_RINGS - 1);
  float spoke = (atan(above, lateral) / (2.0 * PI) + 1.0) * float(FOG_BEAM_SPOKES);
  int row = FOG_BEAMS_ROW + (l.kind == LAMP_FOG_BEAM ? 1 : 0);
  int inner = min(int(ring), FOG_BEAM_RINGS - 2), first = int(spoke);
  vec4 light = vec4(0.0);
  for (int i = 0; i < 4; ++i) {
    int texel = (inner + i / 2) * FOG_BEAM_SPOKES + (first + i % 2) % FOG_BEAM_SPOKES;
    float weight = abs(1.0 - float(i / 2) - ring + float(inner))
        * abs(1.0 - float(i % 2) - spoke + float(first));
    light += weight * texelFetch(samplerTable, ivec2(texel, row), 0);
  }
  // Irradiance from the first two spherical harmonics of the incident light (Hazel 2015).
  vec3 flow = light.x * l.facing + light.y * right + light.z * up;
  float strength = length(flow);
  float directed = min(strength / light.w, 1.0);
  float p = 1.0 + 2.0 * directed, uniformPart = (1.0 - directed) / (1.0 + directed);
  float q = max(0.5 - 0.5 * dot(normal, flow) / strength, 0.0);
  return 0.25 * light.w * (uniformPart + (1.0 - uniformPart) * (p + 1.0) * pow(q, p));
}

// Radiance of a surface that one lamp lights, without shadows.
vec3 lampReflection(Lamp l, Surface s, vec3 towardsEye, vec3 position) {
  vec3 away = position - l.position;
  float distance2 = dot(away, away);
  if (distance2 > l.range * l.range) return vec3(0.0);
  float distance = sqrt(max(distance2, 1e-6));
  vec3 ray = away / distance;
  if (dot(s.normal, ray) >= 0.0) return vec3(0.0);
  // An upper bound of each part is known without the beam's shape, which is expensive.
  const float MAX_SCATTERED = 0.25;
  float left = beamTransmittance(l, distance);
  float given = rangeFalloff(l, distance) / (distance2 + lampSizeSquared(l));
  vec3 direct = l.intensity * given * left * brdfCosine(s, towardsEye, -ray);
  vec3 scattered = l.intensity * given * (1.0 - left) * s.albedo / PI;
  vec3 sum = vec3(0.0);
  if (dot(direct, vec3(1.0)) >= negligibleRadiance()) sum += direct * intensityFraction(l, ray);
  if (isBeam(l) && MAX_SCATTERED * dot(scattered, vec3(1.0)) >= negligibleRadiance()) {
    sum += scattered * scatteredIrradiance(l, ray, s.normal);
  }
  return sum;
}

// Radiance of the mirror image on wet ground of a lamp, as far as `lampReflection` leaves it out
// beyond the lamp's range.
vec3 lampMirrorReflection(Lamp l, Surface s, vec3 towardsEye, vec3 position) {
  vec3 away = position - l.position;
  float distance2 = dot(away, away);
  float distance = sqrt(max(distance2, 1e-6));
  float rest = 1.0 - rangeFalloff(l, distance);
  if (rest <= 0.0) return vec3(0.0);
  vec3 ray = away / distance;
  // Fades to zero where the list of the bearing ends.
  float lateral = ray.x * towardsEye.y - ray.y * towardsEye.x;
  float fade = 1.0 - lateral * lateral / (MIRROR_HALF_ANGLE_SINE * MIRROR_HALF_ANGLE_SINE);
  if (fade <= 0.0 || dot(s.normal, ray) >= 0.0 || dot(ray.xy, towardsEye.xy) <= 0.0) {
    return vec3(0.0);
  }
  float given = intensityFraction(l, ray) * transmittance(distance) * rest * fade * fade
      / distance2;
  return l.intensity * given * specularLobe(s, towardsEye, -ray);
}

// Whether a surface mirrors lamps far beyond their range: wet, smooth and level.
bool isMirrorLike(Surface s) {
  return s.coat > 0.05 && s.alpha < 0.5 && s.normal.z > 0.7;
}

// Phase function of fog droplets (Jendersie and d'Eon 2023), 1/sr: its narrow lobe, of Henyey and
// Greenstein, and its wide one, of Draine.
vec2 dropletPhase(float cosine) {
  const float G_HG = DROPLET_NARROW_G, G_D = DROPLET_WIDE_G, A = DROPLET_WIDE_A;
  float a = 1.0 + G_HG * G_HG - 2.0 * G_HG * cosine, b = 1.0 + G_D * G_D - 2.0 * G_D * cosine;
  float hg = (1.0 - G_HG * G_HG) * inversesqrt(a) / a;
  float draine = (1.0 - G_D * G_D) * inversesqrt(b) / b
      * (1.0 + A * cosine * cosine) / (1.0 + A * (1.0 + 2.0 * G_D * G_D) / 3.0);
  return vec2((1.0 - DROPLET_WIDE_FRACTION) * hg, DROPLET_WIDE_FRACTION * draine) / (4.0 * PI);
}

// Clip a segment of a ray to one side of a plane: keep t where `start` + `slope` t >= 0.
void clipSegment(inout vec2 segment, float start, float slope) {
  float t = -start / (abs(slope) > 1e-6 ? slope : 1e-6);
  if (slope > 0.0) segment.x = max(segment.x, t);
  else segment.y = min(segment.y, t);
}

// Segment of a ray, up to `distance`, that a lamp lights: before it and, for a beam, between 8
// degrees below its axis and 6 above (as tangents).
vec2 litSegment(Lamp l, vec3 eye, vec3 ray, float distance) {
  const float BELOW = 0.141, ABOVE = 0.105;
  vec3 away = eye - l.position;
  vec2 segment = vec2(0.0, distance);
  clipSegment(segment, dot(away, l.facing), dot(ray, l.facing));
  if (isBeam(l)) {
    vec3 up = cross(rightAxis(l.facing), l.facing);
    vec3 floor = up + BELOW * l.facing, ceiling = ABOVE * l.facing - up;
    clipSegment(segment, dot(away, floor), dot(ray, floor));
    clipSegment(segment, dot(away, ceiling), dot(ray, ceiling));
  }
  return segment;
}

// Light of one lamp that air scatters once into a ray. Steps are equal in the cube root of the angle
// at the lamp (equiangular sampling, Kulla and Fajardo 2012), which makes them short where the phase
// function is steep. A beam has sharp edges, so it is sampled at a `jitter` in [0, 1) of each step.
vec3 lampInScattering(Lamp l, vec3 eye, vec3 ray, float distance, float jitter) {
  const int STEPS = 6;
  vec2 segment = litSegment(l, eye, ray, distance);
  if (segment.x >= segment.y) return vec3(0.0);
  float inStep = isBeam(l) ? jitter : 0.5;
  float nearest = dot(l.position - eye, ray);
  float closest = max(length(l.position - eye - nearest * ray), 0.02);
  float first = atan((segment.x - nearest) / closest);
  float span = atan((segment.y - nearest) / closest) - first;
  float sum = 0.0;
  for (int i = 0; i < STEPS; ++i) {
    float u = (float(i) + inStep) / float(STEPS);
    float slope = tan(first + span * u * u * u);
    float sine = inversesqrt(1.0 + slope * slope), t = nearest + closest * slope;
    float fromLamp = closest / sine;
    vec3 away = (eye + t * ray - l.position) / fromLamp;
    float point = fromLamp * fromLamp / (fromLamp * fromLamp + lampSizeSquared(l));
    float left = transmittance(t + fromLamp);
    float wideLeft = isBeam(l) ? unscatteredTransmittance(t + fromLamp) : left;
    vec2 scattered = dropletPhase(-slope * sine) * vec2(left, wideLeft);
    sum += 3.0 * u * u * point * rangeFalloff(l, fromLamp) * intensityFraction(l, away)
        * (scattered.x + scattered.y);
  }
  return l.intensity * (sum * extinction() * span / (closest * float(STEPS)));
}

// Scattered light of all lamps whose glow is seen in the tile of the image at `uv`.
vec3 lampsInScattering(vec2 uv, vec3 eye, vec3 ray, float distance, float jitter) {
  vec3 sum = vec3(0.0);
  if (!isNight() || extinction() <= 0.0) return sum;
  int list = tileList(uv);
  for (int i = 0; i < TEXELS_PER_TILE; ++i) {
    ivec4 four = lampQuad(TILES_ROW, list + i);
    for (int j = 0; j < 4; ++j) {
      if (four[j] < 0) return sum;
      Lamp l = fetchLamp(four[j]);
      float cosine = dot(normalize(l.position - eye), ray);
      if (cosine <= l.minCosine) continue;
      float fade = l.minCosine <= NO_ANGLE_LIMIT
          ? 1.0 : min((cosine - l.minCosine) / (1.0 - l.minCosine) * 3.0, 1.0);
      sum += fade * lampInScattering(l, eye, ray, distance, jitter);
    }
  }
  return sum;
}
