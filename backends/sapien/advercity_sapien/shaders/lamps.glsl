// Lamps of the street and of vehicles, and their glow in fog; needs atmosphere.glsl, surface.glsl.

const int STREET = 0, LOW_BEAM = 1, LENS = 2;

// Rows of the table and sizes of the lists in it, as in `lamp_lists.py`.
const int LAMP_ROW = 1, CELL_ROW = 4, TILE_ROW = 12, BEARING_ROW = 16, COLUMNS = 512;
const int CELLS = 32, TILES_HIGH = 18, TILES_WIDE = 32, BEARINGS = 64;
const int FOURS_OF_CELL = 4, FOURS_OF_TILE = 3, FOURS_OF_BEARING = 2;

struct Lamp {
  vec3 position;
  int kind;
  vec3 facing;
  float window;    // cosine of the angle from it within which its glow is seen
  vec3 intensity;  // kcd, at the peak
  float reach;     // metres, where its light ends
};

// The two lamps of a vehicle are one here; nearer than they are apart, they are not a point.
float spread2(Lamp l) {
  return l.kind == LOW_BEAM ? 2.0 : 0.01;
}

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

// Of the peak, what a dipped beam for right-hand traffic sends along `ray`: a cut-off line that is
// level to the left and rises by 15 degrees to the right. Angles from the axis in degrees, the
// arcs of which are near enough by their first terms.
float lowBeam(vec3 facing, vec3 ray) {
  float forward = dot(ray, facing);
  if (forward <= 0.1) return 0.0;
  vec3 right = vec3(facing.y, -facing.x, 0.0) * inversesqrt(dot(facing.xy, facing.xy));
  float aside = dot(ray, right) / forward, above = dot(ray, cross(right, facing));
  float h = degrees(aside / (1.0 + 0.28 * aside * aside));
  float v = degrees(above * (1.0 + above * above / 6.0));
  float x = v + 0.57 - clamp(0.27 * h, 0.0, 2.07);
  float falls = (h - 1.0) * (h - 1.0) / 288.0;
  if (x < 0.0) falls += (x + 1.0) * (x + 1.0) / 12.25;
  if (v > 0.0) falls += v * v / 225.0;
  if (falls > 12.0) return 0.0;
  return (0.018 + 0.982 / (1.0 + exp(clamp(x / 0.12, -40.0, 40.0)))) * exp(-falls);
}

vec3 intensity(Lamp l, vec3 ray) {
  if (l.kind == LOW_BEAM) return l.intensity * lowBeam(l.facing, ray);
  float cosine = max(dot(l.facing, ray), 0.0);
  return l.intensity * (l.kind == LENS ? cosine * cosine * cosine * cosine : cosine);
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

// Of a lamp's light, what fog leaves to a place. Half of what droplets scatter goes on within a few
// degrees and stays in a beam. What shines all around loses nothing: light that is turned away from
// one place is turned towards it from others.
float reaching(Lamp l, float distance) {
  const float OUT_OF_BEAM = 0.487;
  return l.kind == STREET ? 1.0 : transmittance(OUT_OF_BEAM * distance);
}

// Irradiance times BRDF by one lamp, as if nothing stood between.
vec3 litBy(Lamp l, Surface s, vec3 towardsEye, vec3 position) {
  vec3 away = position - l.position;
  float distance2 = dot(away, away);
  if (distance2 > l.reach * l.reach) return vec3(0.0);
  float distance = sqrt(max(distance2, 1e-6));
  vec3 ray = away / distance;
  if (dot(s.normal, ray) >= 0.0) return vec3(0.0);
  // What comes of it is known before its beam, which is dear: unseen lamps end here.
  vec3 shown = reflected(s, towardsEye, -ray)
      * (reaching(l, distance) * within(l, distance) / (distance2 + spread2(l)));
  if (dot(shown, l.intensity) < faintest()) return vec3(0.0);
  return shown * intensity(l, ray);
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
  return intensity(l, ray) * (transmittance(distance) * rest * fade * fade / distance2)
      * mirroredLobe(s, towardsEye, -ray);
}

bool mirrorsFarLamps(Surface s) {
  return s.coat > 0.05 && s.alpha < 0.5 && s.normal.z > 0.7;
}

// Phase function of fog droplets of 12 µm (Jendersie and d'Eon 2023), 1/sr.
float phase(float cosine) {
  const float G_HG = 0.990455, G_D = 0.566864, A = 23.3775, W = 0.487418;
  float a = 1.0 + G_HG * G_HG - 2.0 * G_HG * cosine, b = 1.0 + G_D * G_D - 2.0 * G_D * cosine;
  float hg = (1.0 - G_HG * G_HG) * inversesqrt(a) / a;
  float draine = (1.0 - G_D * G_D) * inversesqrt(b) / b
      * (1.0 + A * cosine * cosine) / (1.0 + A * (1.0 + 2.0 * G_D * G_D) / 3.0);
  return mix(hg, draine, W) / (4.0 * PI);
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
  if (l.kind == LOW_BEAM) {
    vec3 right = normalize(vec3(l.facing.y, -l.facing.x, 0.0));
    vec3 up = cross(right, l.facing);
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
  float inStep = l.kind == LOW_BEAM ? jitter : 0.5;
  float nearest = dot(l.position - eye, ray);
  float aside = max(length(l.position - eye - nearest * ray), 0.02);
  float first = atan((stretch.x - nearest) / aside);
  float span = atan((stretch.y - nearest) / aside) - first;
  vec3 sum = vec3(0.0);
  for (int i = 0; i < STEPS; ++i) {
    float u = (float(i) + inStep) / float(STEPS);
    float slope = tan(first + span * u * u * u);
    float sine = inversesqrt(1.0 + slope * slope), t = nearest + aside * slope;
    float fromLamp = aside / sine;
    vec3 away = (eye + t * ray - l.position) / fromLamp;
    float point = fromLamp * fromLamp / (fromLamp * fromLamp + spread2(l));
    sum += 3.0 * u * u * point * within(l, fromLamp) * intensity(l, away) * phase(-slope * sine)
        * transmittance(t + fromLamp);
  }
  return sum * (extinction() * span / (aside * float(STEPS)));
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
