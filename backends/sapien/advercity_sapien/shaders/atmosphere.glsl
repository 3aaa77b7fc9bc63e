// The air and the light in it, the same for both renderers.
// Radiance in kcd/m², irradiance in klx, distances in metres, unit directions in the world.
// Needs shader_table.glsl and samplerSky.


// Whether lamps light the scene, as at dusk, too; and whether hardly any light is from the sky.
bool isNight() { return nightFlag() > 0.5; }
bool isDark() { return nightFlag() > 0.9; }

float transmittance(float distance) {
  return exp(-extinction() * distance);
}

// Texture coordinate of a ray in a cubemap whose six faces, each `texels` wide, lie below each
// other. The outermost texels of a face are those of its neighbours, for the filter.
vec2 cubemapUv(vec3 ray, float texels) {
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
  vec2 uv = face.xy * (0.5 - 1.0 / texels) + 0.5;
  return vec2(uv.x, (uv.y + face.z) / 6.0);
}

vec3 sky(vec3 ray) {
  return textureLod(samplerSky, cubemapUv(ray, float(textureSize(samplerSky, 0).x)), 0.0).rgb;
}

// Irradiance by sky and ground on a surface of normal n: spherical harmonics to second order,
// already convolved with the cosine (Ramamoorthi and Hanrahan 2001).
vec3 skyIrradiance(vec3 n) {
  vec3 sum = skyHarmonic(0);
  sum += skyHarmonic(1) * n.y + skyHarmonic(2) * n.z + skyHarmonic(3) * n.x;
  sum += skyHarmonic(4) * n.x * n.y + skyHarmonic(5) * n.y * n.z;
  sum += skyHarmonic(6) * (3.0 * n.z * n.z - 1.0) + skyHarmonic(7) * n.x * n.z;
  sum += skyHarmonic(8) * (n.x * n.x - n.y * n.y);
  return max(sum, 0.0);
}
