// How a surface sends light on; needs atmosphere.glsl.

const float WATER = 1.333;

struct Surface {
  vec3 albedo;   // diffuse, of all directions together
  float alpha;   // width of the specular lobe (GGX)
  float coat;    // share that a smooth layer covers
  float index;   // of refraction, of that layer
  vec3 metal;    // reflectance at normal incidence
  vec3 normal;
};

float fresnel(float index, float cosine) {
  float c = clamp(cosine, 0.0, 1.0);
  float g = sqrt(index * index - 1.0 + c * c);
  float a = (g - c) / (g + c), b = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
  return 0.5 * a * a * (1.0 + b * b);
}

// Mirrored share of light that meets a facet at an angle.
vec3 mirroredShare(Surface s, float cosine) {
  vec3 share = vec3(s.coat > 0.0 ? s.coat * fresnel(s.index, cosine) : 0.0);
  if (s.metal.r + s.metal.g + s.metal.b > 0.0) {
    float m = clamp(1.0 - cosine, 0.0, 1.0), m2 = m * m;
    share += s.metal + (1.0 - s.metal) * (m2 * m2 * m);
  }
  return share;
}

// Cosine at which a smooth surface mirrors as much of its surroundings as a rough one does at
// `cosine` (fitted to GGX of water, within 5 % of the light up to a lobe of 0.45).
float roughCosine(float alpha, float cosine) {
  float c = max(cosine, 0.0);
  return min(sqrt(c * c + 0.36 * alpha * alpha / (alpha + 0.03) * (1.0 + 6.0 * alpha * c)), 1.0);
}

// Of light that passes the coat, how much at this angle against the mean of all.
float passing(Surface s, float cosine) {
  if (s.coat <= 0.0) return 1.0;
  float mean = mix(0.0664, 0.0918, (s.index - WATER) / (1.5 - WATER));
  return (1.0 - s.coat * fresnel(s.index, cosine)) / (1.0 - s.coat * mean);
}

// GGX with height-correlated Smith shadowing, times the cosine of incidence.
vec3 mirroredLobe(Surface s, vec3 towardsEye, vec3 towardsLight) {
  float nl = dot(s.normal, towardsLight);
  if (nl <= 0.0 || (s.coat <= 0.0 && s.metal.g <= 0.0)) return vec3(0.0);
  vec3 h = normalize(towardsEye + towardsLight);
  float nh = max(dot(s.normal, h), 0.0);
  float nv = max(dot(s.normal, towardsEye), 1e-3);
  float a2 = s.alpha * s.alpha;
  float d = nh * nh * (a2 - 1.0) + 1.0;
  float smith = nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2);
  return mirroredShare(s, dot(towardsEye, h)) * (a2 / (PI * d * d) * 0.5 / smith * nl);
}

// BRDF times the cosine of incidence; light passes the coat on its way in and on its way out.
vec3 reflected(Surface s, vec3 towardsEye, vec3 towardsLight) {
  float nl = dot(s.normal, towardsLight);
  if (nl <= 0.0) return vec3(0.0);
  float through = passing(s, nl) * passing(s, dot(s.normal, towardsEye));
  return s.albedo * (nl / PI * through) + mirroredLobe(s, towardsEye, towardsLight);
}
