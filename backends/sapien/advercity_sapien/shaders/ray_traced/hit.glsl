// What a ray brings home.

struct Hit {
  float distance;  // negative: nothing but sky
  vec3 normal;     // unit, towards where the ray came from
  vec3 albedo;
  float roughness;
  float metallic;
  float emission;  // kcd/m² per albedo
  int texture;
  bool snowless;
  uint identity;
};
