// Payload of a ray: the surface that it hits. Needs map_plane.glsl.

struct RayHit {
  float distance;  // negative: the sky
  vec3 normal;     // unit, towards where the ray came from
  vec3 albedo;
  float roughness;
  float metallic;
  float emission;  // kcd/m² per albedo
  int texture;
  bool snowless;
  bool pane;       // glass that is seen through
  uint identity;
  uint material;   // index
  MapPlane plane;  // of the material's images
};
