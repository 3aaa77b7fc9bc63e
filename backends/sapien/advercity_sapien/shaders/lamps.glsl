// Lamps of streets, signals and vehicles, and their glow in fog.
// Needs whole_numbers.glsl, shader_constants.glsl, shader_table.glsl, atmosphere.glsl, surface.glsl, deflection.glsl.

// What every lamp needs of the table's numbers, fetched once a pixel: each fetch costs as much as a step.
float airExtinction = 0.0, negligibleRadiance = 0.0;

// Before all others of this file, at night. Radiance, sum of the colours, that is invisible against
// airlight and sky, is negligible.
void fetchLampAir() {
  airExtinction = extinction();
  negligibleRadiance = 2e-3 * (horizonAirlight().r + horizonAirlight().g + skyHarmonic(0).g);
}

struct Lamp {
  int number;
  vec3 position;
  vec3 middle;  // of both of a pair that lights as one, else its position
  int kind;
  vec3 facing;
  // Cosine of the largest angle off it at which its glow is seen; from NO_ANGLE_LIMIT down to one
  // less, glow that is seen all around and the more faded the less it is.
  float minCosine;
  vec3 intensity;  // kcd, at the peak
  float range;     // metres, where its light ends
};

// Squared size, m²: nearer than its size a lamp is not a point. A fog lamp represents two.
float lampSizeSquared(Lamp l) { return l.kind == LAMP_FOG_BEAM ? 0.4 : 0.01; }

bool isBeam(Lamp l) {
  return l.kind != LAMP_STREET && l.kind != LAMP_LENS;
}

// One of the texels of a section of the table.
vec4 sectionTexel(int row, int texel) {
  uint place = uint(texel), columns = uint(COLUMNS);
  return texelFetch(samplerTable, ivec2(place % columns, row + int(place / columns)), 0);
}

// One of the four texels of the lamp of an entry of a list; they are side by side, in one line of the
// processor's cache.
vec4 lampTexel(int entry, int texel) {
  return sectionTexel(LAMPS_ROW, 4 * (entry & (COLUMNS - 1)) + texel);
}

// Lamp of an entry of a list: one from COLUMNS on stands for both of a pair.
Lamp fetchLamp(int entry) {
  vec4 a = lampTexel(entry, 0), b = lampTexel(entry, 1), c = lampTexel(entry, 2);
  bool isPair = entry >= COLUMNS;
  vec3 middle = a.xyz;
  if (isPair) middle += lampTexel(entry, 3).yzw;
  return Lamp(entry & (COLUMNS - 1), a.xyz, middle, wholeNumber(c.w), b.xyz, b.w,
      c.rgb * (isPair ? 2.0 : 1.0), a.w);
}

// Whether a lamp of an entry may light a surface, before all of the lamp is fetched. What faces away is shaded by
// its own body from light that fog or the road turns, too.
bool mayLight(int entry, vec3 position, vec3 normal) {
  const float BEHIND = 2.0;  // more than from a lamp to the middle of its pair
  vec4 lamp = lampTexel(entry, 0);
  vec3 away = position - lamp.xyz;
  float range = lamp.w + BEHIND;
  return dot(away, normal) < BEHIND && dot(away, away) < range * range;
}

// Four entries of a list of lamps; -1 after the last.
ivec4 lampQuad(int row, int texel) {
  return wholeNumber(sectionTexel(row, texel));
}

// First texel of the list of a cell of the ground, and the one after its last; empty outside all cells.
ivec2 cellList(vec2 position) {
  vec4 grid = lampGrid();
  ivec2 cell = wholeNumber(floor((position - grid.xy) * grid.zw));
  if (any(lessThan(cell, ivec2(0))) || any(greaterThanEqual(cell, ivec2(GRID_CELLS)))) return ivec2(0);
  int number = cell.y * GRID_CELLS + cell.x;
  return wholeNumber(sectionTexel(CELLS_ROW, number).xy);
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

// Angles in degrees of a ray to the right of a beam's axis and above it, the latter by the first terms of
// its arc; approximations of the former make rays to the side nearly parallel. False for rays to the rear.
bool beamAngles(vec3 facing, vec3 ray, out float h, out float v) {
  float forward = dot(ray, facing), perLevel = inversesqrt(dot(facing.xy, facing.xy));
  float aside = perLevel * (ray.x * facing.y - ray.y * facing.x), above = perLevel * (ray.z - forward * facing.z);
  h = degrees(atan(aside / forward));
  v = degrees(above * (1.0 + above * above / 6.0));
  return forward > 0.1;
}

// Droplets scatter half of the light by a few degrees only (the narrow lobe of their phase
// function), and what is deflected so little still lights and shows things. Optical depth of the narrow
// lobe alone:
float narrowDepth(float distance) {
  return (1.0 - DROPLET_WIDE_FRACTION) * airExtinction * distance;
}

// Fraction of light that is not scattered by the wide lobe.
float unscatteredTransmittance(float distance) {
  return exp(-airExtinction * DROPLET_WIDE_FRACTION * distance);
}

// Whether it matters by how little light is deflected: in clearer air, nearly nothing is.
bool deflectsVisibly() { return airExtinction > 6e-3; }

// Ratio of the light that is seen of a lamp-lit surface to what is not scattered, where deflected
// light counts as not deflected.
float undeflectedGain(float distance) { return exp(min(narrowDepth(distance), 8.0)); }

// Fraction of light that droplets deflect farther to one side than so many spreads.
float fractionBeyond(float spreads) {
  float square = max(spreads * spreads, 1e-12);
  return 0.5 - (atan(spreads) + 0.5 * spreads * log(1.0 + 1.0 / square)) / PI;
}

// Intensity of a low beam or a front fog lamp along a ray, relative to its peak, of which fog of an
// optical depth deflects a part by a little: `LampBeam` of the core's lamp_beams.py has the formulas.
// What is below exp(-12) of it is dark.
// `side` is -1 for a beam with left and right swapped.
float beamIntensity(LampBeam b, vec3 facing, vec3 ray, float narrowDepth, float side) {
  float h, v;
  if (!beamAngles(facing, ray, h, v)) return 0.0;
  h *= side;
  float x = v + b.cutoffDrop - clamp(b.kinkSlope * h, 0.0, b.kinkMax);
  float exponent = (h - b.peakRight) * (h - b.peakRight) / b.horizontalSquared;
  if (exponent > 12.0) return 0.0;
  float above = v > 0.0 ? v * v / b.aboveSquared : 0.0;
  float below = x < 0.0 ? (x + b.peakBelowCutoff) * (x + b.peakBelowCutoff) / b.belowSquared : 0.0;
  float dark = exp(clamp(x / b.cutoffSoftness, -40.0, 40.0));
  float sharp = (b.stray + (1.0 - b.stray) / (1.0 + dark)) * exp(-(exponent + above + below));
  if (narrowDepth < 0.03) return sharp;
  float spread = degrees(forwardSpread(narrowDepth));
  float even = x - b.evenTop, beyondCutoff = fractionBeyond(even / spread);
  float soft = beyondCutoff - fractionBeyond((even + b.equivalentHeight) / spread)
      + b.stray * exp(-above) * (1.0 - beyondCutoff);
  return mix(soft * exp(-exponent), sharp, exp(-narrowDepth));
}

// The same of a rear lamp, an indicator or a signal, by the cosine off its axis.
float lensFraction(float cosine) {
  float base = 1.0 + (1.0 - cosine) / LENS_FALLOFF;
  return (inversesqrt(sqrt(base)) / base - LENS_SIDE_FRACTION) / (1.0 - LENS_SIDE_FRACTION);
}

// The same of any lamp at a distance; street lamps are Lambertian. Each kind of beam has a call of its own, so that
// the compiler folds its constants.
float intensityFraction(Lamp l, vec3 ray, float distance) {
  float depth = narrowDepth(distance);
  float side = l.kind == LAMP_LEFT_HAND_LOW_BEAM || l.kind == LAMP_LEFT_HAND_LED_LOW_BEAM ? -1.0 : 1.0;
  if (l.kind == LAMP_LOW_BEAM || l.kind == LAMP_LEFT_HAND_LOW_BEAM)
    return beamIntensity(LOW_BEAM, l.facing, ray, depth, side);
  if (l.kind == LAMP_LED_LOW_BEAM || l.kind == LAMP_LEFT_HAND_LED_LOW_BEAM)
    return beamIntensity(LED_LOW_BEAM, l.facing, ray, depth, side);
  if (l.kind == LAMP_FOG_BEAM) return beamIntensity(FRONT_FOG_BEAM, l.facing, ray, depth, side);
  if (l.kind == LAMP_HIGH_BEAM) return beamIntensity(HIGH_BEAM, l.facing, ray, depth, side);
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

// Fraction of a lamp's light that fog leaves. Lamps that shine all around lose nothing: light that
// is scattered away from one point is scattered to it from others.
float beamTransmittance(Lamp l, float distance) {
  return l.kind == LAMP_STREET ? 1.0 : unscatteredTransmittance(distance);
}

// Light at a point that fog has scattered out of a beam, per kcd of its peak: flow and fluence; perhaps
// with what the road reflects before. The table (fog_beams.py) has it by roots of the metres ahead of the
// lamp, to the side, and above the ground; between eight nodes it is linear. A texel has two of them, one
// above the other, in halves of its numbers (shader_table.py).
vec4 scatteredLight(Lamp l, vec3 position, bool byRoad) {
  vec2 ahead = normalize(l.facing.xy), away = position.xy - l.middle.xy;
  float mounted = l.kind == LAMP_FOG_BEAM ? FOG_LAMP_HEIGHT : LAMP_HEIGHT;
  vec3 point = vec3(dot(away, ahead), dot(away, vec2(ahead.y, -ahead.x)),
      max(position.z - l.middle.z + mounted, 0.0));
  vec3 root = sqrt(abs(point)) * vec3(sign(point.x), 1.0, 1.0);
  vec3 place = (root - FOG_BEAM_FIRST) * FOG_BEAM_PER_ROOT;
  vec3 last = vec3(FOG_BEAM_NODES - 1);
  if (any(lessThan(place, vec3(0.0))) || any(greaterThanEqual(place, last))) return vec4(0.0);
  ivec3 first = min(wholeNumber(floor(place)), FOG_BEAM_NODES - 2);
  vec3 part = place - vec3(first);
  int number = (l.kind == LAMP_FOG_BEAM ? 2 : 0) + (byRoad ? 1 : 0);
  int row = FOG_BEAMS_ROW + number * FOG_BEAM_ROWS;
  vec4 light = vec4(0.0);
  for (int i = 0; i < 4; ++i) {
    ivec2 corner = ivec2(i & 1, i >> 1), node = first.xy + corner;
    vec2 weight = mix(1.0 - part.xy, part.xy, vec2(corner));
    int texel = (node.x * FOG_BEAM_NODES.y + node.y) * FOG_BEAM_NODES.z + first.z;
    uvec4 halves = floatBitsToUint(sectionTexel(row, texel));
    vec4 low = vec4(unpackHalf2x16(halves.x), unpackHalf2x16(halves.y));
    vec4 high = vec4(unpackHalf2x16(halves.z), unpackHalf2x16(halves.w));
    light += weight.x * weight.y / FOG_BEAM_SCALE * mix(low, high, part.z);
  }
  vec2 right = vec2(ahead.y, -ahead.x) * (point.y < 0.0 ? -1.0 : 1.0);
  return vec4(light.x * ahead + light.y * right, light.zw);
}

// Irradiance on a surface by scattered light, from its first two spherical harmonics (Hazel 2015).
float scatteredIrradiance(vec4 light, vec3 normal) {
  float strength = length(light.xyz);
  if (strength <= 0.0) return 0.25 * light.w;
  float directed = min(strength / light.w, 1.0);
  float p = 1.0 + 2.0 * directed, uniformPart = (1.0 - directed) / (1.0 + directed);
  float q = max(0.5 - 0.5 * dot(normal, light.xyz) / strength, 0.0);
  return 0.25 * light.w * (uniformPart + (1.0 - uniformPart) * (p + 1.0) * pow(q, p));
}

// Radiance of a surface that one lamp lights, without shadows; of one that mirrors without its lobe,
// which `lampMirrorReflection` has. Perhaps with the light of beams that comes by the road. `coatLeaves` is
// the transmittance of its coat towards the eye.
vec3 lampReflection(Lamp l, Surface s, vec3 towardsEye, float coatLeaves, vec3 position, bool mirrors,
    bool byRoad) {
  vec3 away = position - l.middle;
  float distance2 = dot(away, away);
  if (distance2 > l.range * l.range) return vec3(0.0);
  float perMetre = inversesqrt(max(distance2, 1e-6)), distance = distance2 * perMetre;
  vec3 ray = away * perMetre;
  // What each part can be is known without the beam's shape, which is expensive. Scattered light is more
  // than this of the peak's only near a lamp, where it is far from negligible, ahead of it or elsewhere.
  const float MAX_SCATTERED = 0.05, MAX_SCATTERED_ASIDE = 6e-3, MAX_BY_ROAD = 6e-3;
  float left = beamTransmittance(l, distance);
  float given = rangeFalloff(l, distance) / (distance2 + lampSizeSquared(l));
  vec3 scattered = l.intensity * s.albedo / PI;
  vec3 sum = vec3(0.0);
  if (dot(s.normal, ray) < 0.0 && dot(l.facing, ray) > 0.0) {
    vec3 reflected = diffuseCosine(s, coatLeaves, -ray);
    if (!mirrors) reflected += specularLobe(s, towardsEye, -ray);
    vec3 direct = l.intensity * (given * left) * reflected;
    if (dot(direct, vec3(1.0)) >= negligibleRadiance) sum += direct * intensityFraction(l, ray, distance);
  }
  float most = (dot(l.facing, ray) > 0.5 ? MAX_SCATTERED : MAX_SCATTERED_ASIDE) * (1.0 - left);
  if (byRoad) most += MAX_BY_ROAD * left;
  if (isBeam(l) && most * given * dot(scattered, vec3(1.0)) >= negligibleRadiance) {
    vec4 light = scatteredLight(l, position, byRoad);
    sum += scattered * rangeFalloff(l, distance) * scatteredIrradiance(light, s.normal);
  }
  return sum;
}

// Radiance of the mirror image on wet ground of a lamp, however far away.
vec3 lampMirrorReflection(Lamp l, Surface s, vec3 towardsEye, vec3 position) {
  vec3 away = position - l.position;
  float distance2 = dot(away, away);
  float distance = sqrt(max(distance2, 1e-6));
  vec3 ray = away / distance;
  // Fades to zero where the list of the bearing ends.
  float lateral = ray.x * towardsEye.y - ray.y * towardsEye.x;
  float fade = 1.0 - lateral * lateral / (MIRROR_HALF_ANGLE_SINE * MIRROR_HALF_ANGLE_SINE);
  if (fade <= 0.0 || dot(s.normal, ray) >= 0.0 || dot(ray.xy, towardsEye.xy) <= 0.0) {
    return vec3(0.0);
  }
  float given = intensityFraction(l, ray, distance) * transmittance(distance) * fade * fade
      / (distance2 + lampSizeSquared(l));
  return l.intensity * given * specularLobe(s, towardsEye, -ray);
}

// Whether a surface mirrors lamps far beyond their range: wet, smooth and level.
bool isMirrorLike(Surface s) {
  return s.coat > 0.05 && s.alpha < 0.4 && s.normal.z > 0.7;
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

// Fraction of a lamp that is visible from a point in the air, at a vector from the lamp; each pack
// has its own.
float airVisibility(Lamp l, vec3 away);

// Ratio of the light that the narrow lobe deflects by an angle on a path, however often, to what it
// deflects once.
float deflectionGain(float angle, float distance) {
  float depth = max(narrowDepth(distance), 1e-3);
  float often = deflectionDensity(angle, forwardSpread(depth)) * (exp(min(depth, 8.0)) - 1.0);
  return often / (depth * deflectionDensity(angle, DROPLET_NARROW_SCALE));
}

// Light of one lamp that air scatters into a segment of a ray, once by the wide lobe or, as often as the
// gain tells, by the narrow one. Steps are equal in the cube root of the angle at the lamp (equiangular
// sampling, Kulla and Fajardo 2012), which makes them short where the phase function is steep; each is
// sampled at `inStep` in [0, 1) of it.
float segmentInScattering(
    Lamp l, vec3 eye, vec3 ray, vec2 segment, int steps, float inStep, float narrowGain) {
  if (segment.x >= segment.y) return 0.0;
  float nearest = dot(l.position - eye, ray);
  float closest = max(length(l.position - eye - nearest * ray), 0.02);
  float first = atan((segment.x - nearest) / closest);
  float span = atan((segment.y - nearest) / closest) - first;
  float sum = 0.0;
  for (int i = 0; i < steps; ++i) {
    float u = (float(i) + inStep) / float(steps);
    float slope = tan(first + span * u * u * u);
    float sine = inversesqrt(1.0 + slope * slope), t = nearest + closest * slope;
    float fromLamp = closest / sine;
    vec3 away = (eye + t * ray - l.position) / fromLamp;
    float point = fromLamp * fromLamp / (fromLamp * fromLamp + lampSizeSquared(l));
    vec2 left = vec2(narrowGain * exp(-airExtinction * (t + fromLamp)), unscatteredTransmittance(t + fromLamp));
    vec2 scattered = dropletPhase(-slope * sine) * left;
    sum += 3.0 * u * u * point * rangeFalloff(l, fromLamp) * intensityFraction(l, away, fromLamp)
        * (scattered.x + scattered.y) * airVisibility(l, away * fromLamp);
  }
  return sum * airExtinction * span / (closest * float(steps));
}

// Light that fog scatters out of a beam, once or often, and then into a ray. Part of it goes along its
// flow, as much as the square of its mean cosine (delta scaling), and the rest is even. Steps are equal in
// the root of the air's opacity, as most of the own beams' is near the eye.
float diffuseInScattering(Lamp l, vec3 eye, vec3 ray, float distance, int steps, float inStep) {
  float along = DROPLET_WIDE_FRACTION * airExtinction;
  float opacity = 1.0 - exp(-along * distance);
  float sum = 0.0;
  for (int i = 0; i < steps; ++i) {
    float u = (float(i) + inStep) / float(steps);
    vec3 point = eye - log(1.0 - opacity * u * u) / along * ray;
    vec4 light = scatteredLight(l, point, true);
    float strength = length(light.xyz);
    if (strength <= 0.0 || airVisibility(l, point - l.position) <= 0.0) continue;
    float directed = light.w * min(strength * strength / (light.w * light.w), 1.0);
    float phase = dropletPhase(-dot(light.xyz, ray) / strength).y / DROPLET_WIDE_FRACTION;
    sum += 2.0 * u * (directed * phase + (light.w - directed) / (4.0 * PI));
  }
  return sum * opacity / float(steps);
}

// Steps along a ray, each sampled once: within the sharp edges of a beam, on either side of them, and of
// light that is scattered often. By how many jitters are averaged, which the packs know.
struct GlowSteps {
  int inBeam;
  int stray;
  int often;
};

// Light of one lamp that air scatters into a ray. Beams have sharp edges 8 degrees below the axis and 6
// above (as tangents); what strays beyond them needs fewer steps.
vec3 lampInScattering(Lamp l, vec3 eye, vec3 ray, float distance, GlowSteps steps, float jitter) {
  const float BELOW = 0.141, ABOVE = 0.105;
  vec3 away = eye - l.position;
  vec2 segment = vec2(0.0, distance);
  clipSegment(segment, dot(away, l.facing), dot(ray, l.facing));
  float lampDistance = length(away);
  float gain = deflectionGain(acos(clamp(-dot(away, ray) / lampDistance, -1.0, 1.0)), lampDistance);
  if (!isBeam(l)) return l.intensity * segmentInScattering(l, eye, ray, segment, steps.inBeam, jitter, gain);
  vec2 core = segment;
  vec3 up = cross(rightAxis(l.facing), l.facing);
  vec3 floor = up + BELOW * l.facing, ceiling = ABOVE * l.facing - up;
  clipSegment(core, dot(away, floor), dot(ray, floor));
  clipSegment(core, dot(away, ceiling), dot(ray, ceiling));
  if (core.x >= core.y) core = segment.yy;
  vec2 before = vec2(segment.x, core.x), behind = vec2(core.y, segment.y);
  float sum = segmentInScattering(l, eye, ray, core, steps.inBeam, jitter, gain)
      + segmentInScattering(l, eye, ray, before, steps.stray, jitter, gain)
      + segmentInScattering(l, eye, ray, behind, steps.stray, jitter, gain);
  if (l.minCosine <= NO_ANGLE_LIMIT) sum += diffuseInScattering(l, eye, ray, distance, steps.often, jitter);
  return l.intensity * sum;
}

// Scattered light of all lamps whose glow is seen in the tile of the image at `uv`.
vec3 lampsInScattering(vec2 uv, vec3 eye, vec3 ray, float distance, GlowSteps steps, float jitter) {
  vec3 sum = vec3(0.0);
  if (airExtinction <= 0.0) return sum;
  int list = tileList(uv);
  for (int i = 0; i < TEXELS_PER_TILE; ++i) {
    ivec4 four = lampQuad(TILES_ROW, list + i);
    for (int j = 0; j < 4; ++j) {
      if (four[j] < 0) return sum;
      Lamp l = fetchLamp(four[j]);
      float cosine = dot(normalize(l.position - eye), ray);
      if (cosine <= l.minCosine) continue;
      // From the square of the angle: halos fade over the outer half of their discs, without an edge.
      float inner = (cosine - l.minCosine) / (1.0 - l.minCosine);
      float fade = l.minCosine <= NO_ANGLE_LIMIT
          ? l.minCosine - NO_ANGLE_LIMIT + 1.0 : smoothstep(0.0, 0.7, inner);
      sum += fade * lampInScattering(l, eye, ray, distance, steps, jitter);
    }
  }
  return sum;
}
