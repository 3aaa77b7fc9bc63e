// Reflection by a surface; needs atmosphere.glsl, shader_constants.glsl.

struct Surface {
  vec3 albedo;   // diffuse
  float alpha;   // width of the specular lobe (GGX)
  float coat;    // fraction covered by a dielectric layer
  float index;   // refractive index of that layer
  vec3 metal;    // reflectance at normal incidence
  vec3 normal;
  float through; // diffuse light that passes to the other side, relative to that reflected
};

// Reflectance of unpolarised light at a dielectric surface.
float fresnel(float index, float cosine) {
  float c = clamp(cosine, 0.0, 1.0);
  float g = sqrt(index * index - 1.0 + c * c);
  float a = (g - c) / (g + c), b = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
  return 0.5 * a * a * (1.0 + b * b);
}

// Specular reflectance of a facet at a cosine of incidence; Schlick's approximation for metals.
vec3 fresnelReflectance(Surface s, float cosine) {
  vec3 fraction = vec3(s.coat > 0.0 ? s.coat * fresnel(s.index, cosine) : 0.0);
  if (s.metal.r + s.metal.g + s.metal.b > 0.0) {
    float m = clamp(1.0 - cosine, 0.0, 1.0), m2 = m * m;
    fraction += s.metal + (1.0 - s.metal) * (m2 * m2 * m);
  }
  return fraction;
}

// Cosine at which a smooth surface reflects as much of its surroundings as one of lobe width
// `alpha` does at `cosine` (fitted to GGX of water, within 5 % of the light up to 0.45).
float roughCosine(float alpha, float cosine) {
  float c = max(cosine, 0.0);
  return min(sqrt(c * c + 0.36 * alpha * alpha / (alpha + 0.03) * (1.0 + 6.0 * alpha * c)), 1.0);
}

// Transmittance of the coat at an angle, relative to its mean over all angles. The means are the
// diffuse external reflectances of water and of an index of 1.5.
float coatTransmittance(Surface s, float cosine) {
  if (s.coat <= 0.0) return 1.0;
  float mean = mix(WATER_EXTERNAL_REFLECTANCE, 0.0918,
      (s.index - WATER_INDEX) / (1.5 - WATER_INDEX));
  return (1.0 - s.coat * fresnel(s.index, cosine)) / (1.0 - s.coat * mean);
}

// Specular BRDF times the cosine of incidence: GGX with height-correlated Smith shadowing.
vec3 specularLobe(Surface s, vec3 towardsEye, vec3 towardsLight) {
  float nl = dot(s.normal, towardsLight);
  if (nl <= 0.0 || (s.coat <= 0.0 && s.metal.g <= 0.0)) return vec3(0.0);
  vec3 h = normalize(towardsEye + towardsLight);
  float nh = max(dot(s.normal, h), 0.0);
  float nv = max(dot(s.normal, towardsEye), 1e-3);
  float a2 = s.alpha * s.alpha;
  float d = nh * nh * (a2 - 1.0) + 1.0;
  float smith = nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2);
  return fresnelReflectance(s, dot(towardsEye, h)) * (a2 / (PI * d * d) * 0.5 / smith * nl);
}

// Diffuse BRDF times the cosine of incidence; light passes the coat twice, in and out. The transmittance on
// its way out is the same for all lights.
vec3 diffuseCosine(Surface s, float coatLeaves, vec3 towardsLight) {
  float nl = dot(s.normal, towardsLight);
  if (nl <= 0.0) return s.albedo * (-nl / PI * s.through);
  return s.albedo * (nl / PI * coatTransmittance(s, nl) * coatLeaves);
}

// BRDF times the cosine of incidence.
vec3 brdfCosine(Surface s, vec3 towardsEye, vec3 towardsLight) {
  float coatLeaves = coatTransmittance(s, dot(s.normal, towardsEye));
  return diffuseCosine(s, coatLeaves, towardsLight) + specularLobe(s, towardsEye, towardsLight);
}

// A pane of tinted glass: index, and transmittance besides what both its faces reflect.
const float GLASS_INDEX = 1.52, GLASS_TRANSMITTANCE = 0.72;

// Reflectance of a pane: light that passes the first face is partly reflected by the second.
float paneReflectance(float cosine) {
  float face = fresnel(GLASS_INDEX, abs(cosine));
  return 2.0 * face / (1.0 + face);
}

// The outer face of a pane, for what it mirrors of lights.
Surface paneSurface(vec3 normal) {
  return Surface(vec3(0.0), 0.03, 1.0, GLASS_INDEX, vec3(0.0), normal, 0.0);
}
