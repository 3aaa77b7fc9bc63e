// Lamps of the street and of vehicles, and their glow in fog; needs atmosphere.glsl, surface.glsl.

const int STREET = 0, LOW_BEAM = 1, LENS = 2;

struct Lamp {
  vec3 position;
  int kind;
  vec3 facing;
  vec3 intensity;  // kcd, at the peak
};

// The two lamps of a vehicle are one here; nearer than they are apart, they are not a point.
float spread2(Lamp l) {
  return l.kind == LOW_BEAM ? 2.0 : 0.01;
}

int lampCount() {
  return int(texelFetch(samplerTable, ivec2(0, 1), 0).x);
}

Lamp lamp(int i) {
  vec4 a = texelFetch(samplerTable, ivec2(3 * i + 1, 1), 0);
  vec4 b = texelFetch(samplerTable, ivec2(3 * i + 2, 1), 0);
  vec4 c = texelFetch(samplerTable, ivec2(3 * i + 3, 1), 0);
  return Lamp(a.xyz, int(a.w), b.xyz, c.rgb);
}

// Of the peak, what a dipped beam for right-hand traffic sends along `ray`: a cut-off line that is
// level to the left and rises by 15 degrees to the right. Angles from the axis in degrees.
float lowBeam(vec3 facing, vec3 ray) {
  vec3 right = normalize(vec3(facing.y, -facing.x, 0.0));
  vec3 up = cross(right, facing);
  float forward = dot(ray, facing);
  if (forward <= 0.0) return 0.0;
  float h = degrees(atan(dot(ray, right), forward));
  float v = degrees(asin(clamp(dot(ray, up), -1.0, 1.0)));
  float x = v + 0.57 - clamp(0.27 * h, 0.0, 2.07);
  float vertical = 0.018 + 0.982 / (1.0 + exp(min(x / 0.12, 80.0)));
  if (x < 0.0) vertical *= exp(-(x + 1.0) * (x + 1.0) / 12.25);
  if (v > 0.0) vertical *= exp(-v * v / 225.0);
  return vertical * exp(-(h - 1.0) * (h - 1.0) / 288.0);
}

vec3 intensity(Lamp l, vec3 ray) {
  if (l.kind == LOW_BEAM) return l.intensity * lowBeam(l.facing, ray);
  float cosine = max(dot(l.facing, ray), 0.0);
  return l.intensity * (l.kind == LENS ? cosine * cosine * cosine * cosine : cosine);
}

// Irradiance times BRDF by one lamp, as if nothing stood between.
vec3 litBy(Lamp l, Surface s, vec3 towardsEye, vec3 position) {
  vec3 away = position - l.position;
  float distance2 = dot(away, away);
  float distance = sqrt(max(distance2, 1e-6));
  vec3 ray = away / distance;
  if (dot(s.normal, ray) >= 0.0) return vec3(0.0);
  return intensity(l, ray) * transmittance(distance) / (distance2 + spread2(l))
      * reflected(s, towardsEye, -ray);
}

// Phase function of fog droplets of 12 µm (Jendersie and d'Eon 2023), 1/sr.
float phase(float cosine) {
  const float G_HG = 0.990455, G_D = 0.566864, A = 23.3775, W = 0.487418;
  float hg = (1.0 - G_HG * G_HG) / pow(1.0 + G_HG * G_HG - 2.0 * G_HG * cosine, 1.5);
  float draine = (1.0 - G_D * G_D) / pow(1.0 + G_D * G_D - 2.0 * G_D * cosine, 1.5)
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
  const int STEPS = 8;
  vec2 stretch = litStretch(l, eye, ray, distance);
  if (stretch.x >= stretch.y) return vec3(0.0);
  float within = l.kind == LOW_BEAM ? jitter : 0.5;
  float nearest = dot(l.position - eye, ray);
  float aside = max(length(l.position - eye - nearest * ray), 0.02);
  float first = atan((stretch.x - nearest) / aside);
  float span = atan((stretch.y - nearest) / aside) - first;
  vec3 sum = vec3(0.0);
  for (int i = 0; i < STEPS; ++i) {
    float u = (float(i) + within) / float(STEPS);
    float angle = first + span * u * u * u;
    float t = nearest + aside * tan(angle);
    float fromLamp = aside / cos(angle);
    vec3 away = (eye + t * ray - l.position) / fromLamp;
    float point = fromLamp * fromLamp / (fromLamp * fromLamp + spread2(l));
    sum += 3.0 * u * u * point * intensity(l, away) * phase(-sin(angle))
        * transmittance(t + fromLamp);
  }
  return sum * (extinction() * span / (aside * float(STEPS)));
}

// In air as clear as this no glow is seen, and it is the dearest part of a picture.
const float UNSEEN_BELOW = 5e-4;

vec3 glowOfLamps(vec3 eye, vec3 ray, float distance, float jitter) {
  vec3 sum = vec3(0.0);
  if (extinction() < UNSEEN_BELOW) return sum;
  for (int i = 0; i < lampCount(); ++i) {
    Lamp l = lamp(i);
    // Scattered light has come at least as far as direct light.
    if (transmittance(length(l.position - eye)) < 1e-3) continue;
    sum += glow(l, eye, ray, distance, jitter);
  }
  return sum;
}
