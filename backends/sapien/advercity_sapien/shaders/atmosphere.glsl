// The air and the light in it, the same for both renderers.
// Radiance in kcd/m², irradiance in klx, distances in metres, directions unit and in the world.
// Needs samplerTable and samplerSky, which `tables.py` fills.

const float PI = 3.14159265358979;

vec4 parameter(int column) {
  return texelFetch(samplerTable, ivec2(column, 0), 0);
}

float extinction() { return parameter(0).x; }
float wetness() { return parameter(0).y; }
bool night() { return parameter(1).w > 0.5; }
vec3 sunIrradiance() { return parameter(3).rgb; }
vec3 towardsSun() { return parameter(4).xyz; }

float transmittance(float distance) {
  return exp(-extinction() * distance);
}

// Where a ray meets a cubemap whose six faces, so many texels wide, lie below each other; each is
// filtered within itself.
vec2 onFaces(vec3 ray, float texels) {
  vec3 size = abs(ray);
  vec3 face;
  if (size.x >= size.y && size.x >= size.z) {
    face = ray.x > 0.0 ? vec3(-ray.y, -ray.z, 0.0) : vec3(ray.y, -ray.z, 1.0);
    face.xy /= size.x;
  } else if (size.y >= size.z) {
    face = ray.y > 0.0 ? vec3(ray.x, -ray.z, 2.0) : vec3(-ray.x, -ray.z, 3.0);
    face.xy /= size.y;
  } else {
    face = ray.z > 0.0 ? vec3(-ray.y, ray.x, 4.0) : vec3(-ray.y, -ray.x, 5.0);
    face.xy /= size.z;
  }
  vec2 uv = clamp(face.xy * 0.5 + 0.5, 0.5 / texels, 1.0 - 0.5 / texels);
  return vec2(uv.x, (uv.y + face.z) / 6.0);
}

vec3 sky(vec3 ray) {
  return textureLod(samplerSky, onFaces(ray, float(textureSize(samplerSky, 0).x)), 0.0).rgb;
}

// Irradiance by sky and ground light: spherical harmonics to second order, already convolved.
vec3 skyIrradiance(vec3 n) {
  vec3 sum = parameter(5).rgb;
  sum += parameter(6).rgb * n.y + parameter(7).rgb * n.z + parameter(8).rgb * n.x;
  sum += parameter(9).rgb * n.x * n.y + parameter(10).rgb * n.y * n.z;
  sum += parameter(11).rgb * (3.0 * n.z * n.z - 1.0) + parameter(12).rgb * n.x * n.z;
  sum += parameter(13).rgb * (n.x * n.x - n.y * n.y);
  return max(sum, 0.0);
}
