// How a surface sends light on; needs atmosphere.glsl.

struct Surface {
  vec3 albedo;
  float alpha;     // width of the specular lobe (GGX)
  vec3 specular;   // reflectance at normal incidence
  vec3 normal;
};

// A water film darkens what is rough and porous and puts a smooth coat on it
// (Ångström 1925; Lekner and Dorf 1988). What is smooth already, such as car paint, only beads.
Surface surface(vec3 albedo, float roughness, float metallic, vec3 normal) {
  const float EXTERNAL = 0.0664, INTERNAL = 0.4746, INDEX_MATCHED = 0.85;
  float porous = smoothstep(0.45, 0.6, roughness) * (1.0 - metallic);
  float wet = wetness() * porous * mix(0.5, 1.0, max(normal.z, 0.0));
  vec3 soaked = INDEX_MATCHED * (1.0 - EXTERNAL) * (1.0 - INTERNAL) * albedo
      / (1.0 - albedo * INTERNAL);
  float film = smoothstep(0.3, 1.0, wet);
  float coat = 0.04 * (1.0 - porous) * (1.0 - metallic) + 0.0204 * film;

  Surface s;
  s.albedo = mix(albedo, soaked, wet) * (1.0 - metallic) * (1.0 - coat);
  s.alpha = max(mix(roughness * roughness, 0.15, film), 0.02);
  s.specular = vec3(coat) + albedo * metallic;
  s.normal = normal;
  return s;
}

vec3 fresnel(vec3 atNormal, float cosine) {
  float m = clamp(1.0 - cosine, 0.0, 1.0);
  float m2 = m * m;
  return atNormal + step(1e-4, atNormal) * (1.0 - atNormal) * (m2 * m2 * m);
}

// BRDF times the cosine of incidence: Lambert plus GGX with height-correlated Smith shadowing.
vec3 reflected(Surface s, vec3 towardsEye, vec3 towardsLight) {
  float nl = dot(s.normal, towardsLight);
  if (nl <= 0.0) return vec3(0.0);
  vec3 result = s.albedo * (nl / PI);
  if (s.specular.g > 1e-4) {
    vec3 h = normalize(towardsEye + towardsLight);
    float nh = max(dot(s.normal, h), 0.0);
    float nv = max(dot(s.normal, towardsEye), 1e-3);
    float a2 = s.alpha * s.alpha;
    float d = nh * nh * (a2 - 1.0) + 1.0;
    float smith = nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2);
    vec3 f = fresnel(s.specular, dot(towardsEye, h));
    result += f * (a2 / (PI * d * d) * 0.5 / smith * nl);
  }
  return result;
}
