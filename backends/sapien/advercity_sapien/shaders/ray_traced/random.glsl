// Random numbers as a function of pixel and seed, and directions drawn with them.

uint randomState;

uint hash(uint x) {  // PCG, Jarzynski and Olano 2020
  x = x * 747796405u + 2891336453u;
  uint word = ((x >> ((x >> 28u) + 4u)) ^ x) * 277803737u;
  return (word >> 22u) ^ word;
}

void seedRandom(uvec3 key) {
  randomState = hash(key.x + hash(key.y + hash(key.z)));
}

// Uniform in [0, 1).
float random() {
  randomState = randomState * 747796405u + 2891336453u;
  uint word = ((randomState >> ((randomState >> 28u) + 4u)) ^ randomState) * 277803737u;
  return float(((word >> 22u) ^ word) >> 8u) / 16777216.0;
}

// Rotation whose z axis is a normal.
mat3 tangentFrame(vec3 normal) {
  vec3 helper = abs(normal.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0);
  vec3 tangent = normalize(cross(helper, normal));
  return mat3(tangent, cross(normal, tangent), normal);
}

// Direction in a surface's frame, distributed with the cosine.
vec3 cosineDirection() {
  float azimuth = 2.0 * PI * random(), radius2 = random();
  return vec3(sqrt(radius2) * vec2(cos(azimuth), sin(azimuth)), sqrt(1.0 - radius2));
}

// Normal of a GGX microfacet that is visible from `eye`, both in the surface's frame (Heitz 2018).
vec3 visibleNormal(vec3 eye, float alpha) {
  vec3 stretched = normalize(vec3(alpha * eye.xy, eye.z));
  float length2 = dot(stretched.xy, stretched.xy);
  vec3 t1 = length2 > 0.0 ? vec3(-stretched.y, stretched.x, 0.0) * inversesqrt(length2)
                          : vec3(1.0, 0.0, 0.0);
  vec3 t2 = cross(stretched, t1);
  float azimuth = 2.0 * PI * random(), radius = sqrt(random());
  float p1 = radius * cos(azimuth), p2 = radius * sin(azimuth), s = 0.5 * (1.0 + stretched.z);
  p2 = mix(sqrt(max(1.0 - p1 * p1, 0.0)), p2, s);
  vec3 n = p1 * t1 + p2 * t2 + sqrt(max(1.0 - p1 * p1 - p2 * p2, 0.0)) * stretched;
  return normalize(vec3(alpha * n.xy, max(n.z, 0.0)));
}
