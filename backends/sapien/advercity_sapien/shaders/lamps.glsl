// Lamps of the street and of vehicles, and their glow in fog; needs atmosphere.glsl, surface.glsl.

const int STREET = 0, LOW_BEAM = 1, LENS = 2, FOG_BEAM = 3;

// Rows of the table and sizes of the lists in it, as in `lamp_lists.py`.
const int LAMP_ROW = 1, CELL_ROW = 4, TILE_ROW = 12, BEARING_ROW = 16, COLUMNS = 512;
const int CELLS = 32, TILES_HIGH = 18, TILES_WIDE = 32, BEARINGS = 64;
const int FOURS_OF_CELL = 4, FOURS_OF_TILE = 3, FOURS_OF_BEARING = 2;
// Below them, one row for dipped beams and one for fog lamps, as in `beams_in_fog.py`.
const int SPREAD_ROW = 17, SPREAD_RINGS = 16, SPREAD_SPOKES = 32;

struct Lamp {
  vec3 position;
  int kind;
  vec3 facing;
  float window;    // cosine of the angle from it within which its glow is seen
  vec3 intensity;  // kcd, at the peak
  float reach;     // metres, where its light ends
};

// Square of a lamp's size: nearer than that it is not a point. One fog lamp stands for two.
float size2(Lamp l) { return l.kind == FOG_BEAM ? 0.4 : 0.01; }

bool isBeam(Lamp l) { return l.kind == LOW_BEAM || l.kind == FOG_BEAM; }

Lamp lamp(int i) {
  vec4 a = texelFetch(samplerTable, ivec2(i, LAMP_ROW), 0);
  vec4 b = texelFetch(samplerTable, ivec2(i, LAMP_ROW + 1), 0);
  vec4 c = texelFetch(samplerTable, ivec2(i, LAMP_ROW + 2), 0);
  return Lamp(a.xyz, int(a.w), b.xyz, b.w, c.rgb, c.w);
}

// Four lamps of a list, -1 behind the last.
ivec4 fourLamps(int row, int texel) {
  return ivec4(texelFetch(samplerTable, ivec2(texel % COLUMNS, row + texel / COLUMNS), 0));
}

// Lists of lamps begin at these texels; -1 is none.
int listOfCell(vec2 position) {
  vec4 ground = parameter(15);
  ivec2 cell = ivec2(floor((position - ground.xy) * ground.zw));
  if (any(lessThan(cell, ivec2(0))) || any(greaterThanEqual(cell, ivec2(CELLS)))) return -1;
  return (cell.y * CELLS + cell.x) * FOURS_OF_CELL;
}

int listOfBearing(vec2 away) {
  int bin = int((atan(away.y, away.x) / (2.0 * PI) + 0.5) * float(BEARINGS));
  return clamp(bin, 0, BEARINGS - 1) * FOURS_OF_BEARING;
}

int listOfTile(vec2 uv) {
  ivec2 tile = clamp(ivec2(uv * vec2(TILES_WIDE, TILES_HIGH)), ivec2(0),
      ivec2(TILES_WIDE - 1, TILES_HIGH - 1));
  return (tile.y * TILES_WIDE + tile.x) * FOURS_OF_TILE;
}

vec3 rightOf(vec3 facing) {
  return vec3(facing.y, -facing.x, 0.0) * inversesqrt(dot(facing.xy, facing.xy));
}

// Angles in degrees of a ray to the right of a beam's axis and above it, near enough by the first
// terms of their arcs; false for rays that go no way ahead.
bool offAxis(vec3 facing, vec3 ray, out float h, out float v) {
  float forward = dot(ray, facing);
  vec3 right = rightOf(facing);
  float aside = dot(ray, right) / forward, above = dot(ray, cross(right, facing));
  h = degrees(aside / (1.0 + 0.28 * aside * aside));
  v = degrees(above * (1.0 + above * above / 6.0));
  return forward > 0.1;
}

// Of the peak, what a dipped beam for right-hand traffic sends along `ray`: a cut-off line that is
// level to the left and rises by 15 degrees to the right.
float lowBeam(vec3 facing, vec3 ray) {
  float h, v;
  if (!offAxis(facing, ray, h, v)) return 0.0;
  float x = v + 0.57 - clamp(0.27 * h, 0.0, 2.07);
  float falls = (h - 1.0) * (h - 1.0) / 288.0;
  if (x < 0.0) falls += (x + 1.0) * (x + 1.0) / 12.25;
  if (v > 0.0) falls += v * v / 225.0;
  if (falls > 12.0) return 0.0;
  return (0.018 + 0.982 / (1.0 + exp(clamp(x / 0.12, -40.0, 40.0)))) * exp(-falls);
}

// The same of a front fog lamp: wide, and cut off level at its axis.
float fogBeam(vec3 facing, vec3 ray) {
  float h, v;
  if (!offAxis(facing, ray, h, v)) return 0.0;
  float falls = h * h / 800.0;
  if (v < 0.0) falls += (v + 1.0) * (v + 1.0) / 12.25;
  else falls += v * v / 225.0;
  if (falls > 12.0) return 0.0;
  return (0.018 + 0.982 / (1.0 + exp(clamp(v / 0.2, -40.0, 40.0)))) * exp(-falls);
}

// The same of a rear lamp, an indicator or a signal, as `lens_share` in `lamps.py`.
float lens(float cosine) {
  const float FALLS = 0.0218524, SIDEWAYS = 0.0081778;
  float rest = 1.0 + (1.0 - cosine) / FALLS;
  return (inversesqrt(sqrt(rest)) / rest - SIDEWAYS) / (1.0 - SIDEWAYS);
}

// The same of any lamp.
float beam(Lamp l, vec3 ray) {
  if (l.kind == LOW_BEAM) return lowBeam(l.facing, ray);
  if (l.kind == FOG_BEAM) return fogBeam(l.facing, ray);
  float cosine = max(dot(l.facing, ray), 0.0);
  return l.kind == LENS ? lens(cosine) : cosine;
}

// Of a lamp's light, what lights a place: it ends softly where the lists end.
float within(Lamp l, float distance) {
  float share = distance / l.reach;
  share *= share;
  share = clamp(1.0 - share * share, 0.0, 1.0);
  return share * share;
}

// Radiance, all colours together, that does not show beside the airlight and the sky.
float faintest() { return 5e-3 * (parameter(1).r + parameter(1).g + parameter(5).g); }

// Half of what droplets scatter goes on within a few degrees. It stays in a beam, and what a place
// in a picture loses of it comes from the places beside.
const float TURNED_ASIDE = 0.487;

float keepingOn(float distance) { return transmittance(TURNED_ASIDE * distance); }

// By how much more is seen of light that lamps give to a place than is left of a point's; no more
// than still shows.
float seenAround(float distance) {
  return exp(min((1.0 - TURNED_ASIDE) * extinction() * distance, 8.0));
}

// Of a lamp's light, what fog leaves to a place. What shines all around loses nothing: light that is
// turned away from one place is turned towards it from others.
float reaching(Lamp l, float distance) {
  return l.kind == STREET ? 1.0 : keepingOn(distance);
}

// Irradiance on a surface by the light that fog turns aside from all of a beam, per klx that the
// beam's peak would give without fog, if all were turned aside up to there.
float turnedAside(Lamp l, vec3 ray, vec3 normal) {
  vec3 right = rightOf(l.facing);
  vec3 up = cross(right, l.facing);
  float aside = dot(ray, right), above = dot(ray, up);
  float ring = sqrt(acos(clamp(dot(ray, l.facing), -1.0, 1.0)) / PI) * float(SPREAD_RINGS - 1);
  float spoke = (atan(above, aside) / (2.0 * PI) + 1.0) * float(SPREAD_SPOKES);
  int row = SPREAD_ROW + (l.kind == FOG_BEAM ? 1 : 0);
  int inner = min(int(ring), SPREAD_RINGS - 2), first = int(spoke);
  vec4 light = vec4(0.0);
  for (int i = 0; i < 4; ++i) {
    int texel = (inner + i / 2) * SPREAD_SPOKES + (first + i % 2) % SPREAD_SPOKES;
    float weight = abs(1.0 - float(i / 2) - ring + float(inner))
        * abs(1.0 - float(i % 2) - spoke + float(first));
    light += weight * texelFetch(samplerTable, ivec2(texel, row), 0);
  }
  // From all around and along a way to what a surface gets of it (Hazel 2015).
  vec3 flow = light.x * l.facing + light.y * right + light.z * up;
  float strength = length(flow);
  float onTheWay = min(strength / light.w, 1.0);
  float p = 1.0 + 2.0 * onTheWay, even = (1.0 - onTheWay) / (1.0 + onTheWay);
  float q = max(0.5 - 0.5 * dot(normal, flow) / strength, 0.0);
  return 0.25 * light.w * (even + (1.0 - even) * (p + 1.0) * pow(q, p));
}

// Irradiance times BRDF by one lamp, as if nothing stood between.
vec3 litBy(Lamp l, Surface s, vec3 towardsEye, vec3 position) {
  vec3 away = position - l.position;
  float distance2 = dot(away, away);
  if (distance2 > l.reach * l.reach) return vec3(0.0);
  float distance = sqrt(max(distance2, 1e-6));
  vec3 ray = away / distance;
  if (dot(s.normal, ray) >= 0.0) return vec3(0.0);
  // What comes of it at most is known before its beam, which is dear.
  const float MOST_TURNED_ASIDE = 0.25;
  float left = reaching(l, distance), given = within(l, distance) / (distance2 + size2(l));
  vec3 straight = l.intensity * given * left * reflected(s, towardsEye, -ray);
  vec3 turned = l.intensity * given * (1.0 - left) * s.albedo / PI;
  vec3 sum = vec3(0.0);
  if (dot(straight, vec3(1.0)) >= faintest()) sum += straight * beam(l, ray);
  if (isBeam(l) && MOST_TURNED_ASIDE * dot(turned, vec3(1.0)) >= faintest()) {
    sum += turned * turnedAside(l, ray, s.normal);
  }
  return sum;
}

// The mirrored image on wet ground of a lamp too far away to light it.
vec3 mirroredFrom(Lamp l, Surface s, vec3 towardsEye, vec3 position) {
  const float AROUND = 0.156;  // sine of the angle to its side where lists end
  vec3 away = position - l.position;
  float distance2 = dot(away, away);
  float distance = sqrt(max(distance2, 1e-6));
  float rest = 1.0 - within(l, distance);
  if (rest <= 0.0) return vec3(0.0);
  vec3 ray = away / distance;
  float aside = ray.x * towardsEye.y - ray.y * towardsEye.x;
  float fade = 1.0 - aside * aside / (AROUND * AROUND);
  if (fade <= 0.0 || dot(s.normal, ray) >= 0.0 || dot(ray.xy, towardsEye.xy) <= 0.0) {
    return vec3(0.0);
  }
  return l.intensity * (beam(l, ray) * transmittance(distance) * rest * fade * fade / distance2)
      * mirroredLobe(s, towardsEye, -ray);
}

bool mirrorsFarLamps(Surface s) {
  return s.coat > 0.05 && s.alpha < 0.5 && s.normal.z > 0.7;
}

// Phase function of fog droplets of 12 µm (Jendersie and d'Eon 2023), 1/sr: its narrow lobe and
// its wide one.
vec2 phase(float cosine) {
  const float G_HG = 0.990455, G_D = 0.566864, A = 23.3775;
  float a = 1.0 + G_HG * G_HG - 2.0 * G_HG * cosine, b = 1.0 + G_D * G_D - 2.0 * G_D * cosine;
  float hg = (1.0 - G_HG * G_HG) * inversesqrt(a) / a;
  float draine = (1.0 - G_D * G_D) * inversesqrt(b) / b
      * (1.0 + A * cosine * cosine) / (1.0 + A * (1.0 + 2.0 * G_D * G_D) / 3.0);
  return vec2((1.0 - TURNED_ASIDE) * hg, TURNED_ASIDE * draine) / (4.0 * PI);
}

// Cuts from a stretch of a ray what lies behind a plane: keeps t where `start` + `slope` t >= 0.
void clip(inout vec2 stretch, float start, float slope) {
  float t = -start / (abs(slope) > 1e-6 ? slope : 1e-6);
  if (slope > 0.0) stretch.x = max(stretch.x, t);
  else stretch.y = min(stretch.y, t);
}

// The stretch of a ray, up to `distance`, that a lamp lights: what is before it and, for a dipped
// beam, between 8 degrees below and 6 above its axis.
vec2 litStretch(Lamp l, vec3 eye, vec3 ray, float distance) {
  const float BELOW = 0.141, ABOVE = 0.105;
  vec3 away = eye - l.position;
  vec2 stretch = vec2(0.0, distance);
  clip(stretch, dot(away, l.facing), dot(ray, l.facing));
  if (isBeam(l)) {
    vec3 up = cross(rightOf(l.facing), l.facing);
    vec3 floor = up + BELOW * l.facing, ceiling = ABOVE * l.facing - up;
    clip(stretch, dot(away, floor), dot(ray, floor));
    clip(stretch, dot(away, ceiling), dot(ray, ceiling));
  }
  return stretch;
}

// Light of one lamp scattered once into a ray. Steps are equal in the cube root of the angle at
// the lamp (equiangular, Kulla and Fajardo 2012), so that they are close where the phase is steep.
// The sharp edges of a beam are sampled at a `jitter` in [0, 1) of each step.
vec3 glow(Lamp l, vec3 eye, vec3 ray, float distance, float jitter) {
  const int STEPS = 6;
  vec2 stretch = litStretch(l, eye, ray, distance);
  if (stretch.x >= stretch.y) return vec3(0.0);
  float inStep = isBeam(l) ? jitter : 0.5;
  float nearest = dot(l.position - eye, ray);
  float aside = max(length(l.position - eye - nearest * ray), 0.02);
  float first = atan((stretch.x - nearest) / aside);
  float span = atan((stretch.y - nearest) / aside) - first;
  float sum = 0.0;
  for (int i = 0; i < STEPS; ++i) {
    float u = (float(i) + inStep) / float(STEPS);
    float slope = tan(first + span * u * u * u);
    float sine = inversesqrt(1.0 + slope * slope), t = nearest + aside * slope;
    float fromLamp = aside / sine;
    vec3 away = (eye + t * ray - l.position) / fromLamp;
    float point = fromLamp * fromLamp / (fromLamp * fromLamp + size2(l));
    float left = transmittance(t + fromLamp);
    vec2 turned = phase(-slope * sine) * vec2(left, isBeam(l) ? keepingOn(t + fromLamp) : left);
    sum += 3.0 * u * u * point * within(l, fromLamp) * beam(l, away) * (turned.x + turned.y);
  }
  return l.intensity * (sum * extinction() * span / (aside * float(STEPS)));
}

// Of all lamps whose glow is seen in the tile of the picture at `uv`.
vec3 glowOfLamps(vec2 uv, vec3 eye, vec3 ray, float distance, float jitter) {
  vec3 sum = vec3(0.0);
  if (!night() || extinction() <= 0.0) return sum;
  int list = listOfTile(uv);
  for (int i = 0; i < FOURS_OF_TILE; ++i) {
    ivec4 four = fourLamps(TILE_ROW, list + i);
    for (int j = 0; j < 4; ++j) {
      if (four[j] < 0) return sum;
      Lamp l = lamp(four[j]);
      float inside = dot(normalize(l.position - eye), ray);
      if (inside <= l.window) continue;
      float fade = l.window < -1.5 ? 1.0 : min((inside - l.window) / (1.0 - l.window) * 3.0, 1.0);
      sum += fade * glow(l, eye, ray, distance, jitter);
    }
  }
  return sum;
}
