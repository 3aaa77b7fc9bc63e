// The surface that a ray hits; for hit shaders. Needs map_plane.glsl, scene.glsl and body_state.glsl.

hitAttributeEXT vec2 barycentric;

struct RayHit {
  float distance;
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

Vertex vertexOf(uint geometry, uint corner) {
  return vertices[nonuniformEXT(geometry)].v[
      indices[nonuniformEXT(geometry)].i[3 * gl_PrimitiveID + corner]];
}

vec3 worldPosition(Vertex v) { return gl_ObjectToWorldEXT * vec4(v.x, v.y, v.z, 1.0); }

MapPlane meshPlane(Vertex a, Vertex b, Vertex c, vec3 weights, vec3 normal) {
  mat3x2 uv = mat3x2(a.u, a.v, b.u, b.v, c.u, c.v);
  vec3 corner = worldPosition(a);
  return meshPlane(uv * weights, normal, worldPosition(b) - corner, worldPosition(c) - corner,
      uv[1] - uv[0], uv[2] - uv[0]);
}

// Whether it is the box around everything, the body that carries the textures (shader_bindings.py), or too far.
bool isSky() { return gl_InstanceCustomIndexEXT + gl_GeometryIndexEXT == 0 || gl_HitTEXT > FAR_M; }

RayHit findHit() {
  GeometryInstance instance = geometryInstances.i[gl_InstanceCustomIndexEXT + gl_GeometryIndexEXT];
  uint geometry = instance.geometryIndex;
  Material material = materials[nonuniformEXT(instance.materialIndex)].m;
  Vertex a = vertexOf(geometry, 0), b = vertexOf(geometry, 1), c = vertexOf(geometry, 2);
  mat3 normals = mat3(a.nx, a.ny, a.nz, b.nx, b.ny, b.nz, c.nx, c.ny, c.nz);
  vec3 weights = vec3(1.0 - barycentric.x - barycentric.y, barycentric);
  vec3 normal = normals * weights;
  normal = normalize(vec3(normal * gl_WorldToObjectEXT));
  // Leaves have the normal of their crown, on the side that is seen.
  bool back = int(material.emission.y) == TEXTURE_LEAVES
      ? dot(normal, gl_WorldRayDirectionEXT) > 0.0
      : gl_HitKindEXT == gl_HitKindBackFacingTriangleEXT;

  RayHit hit;
  hit.distance = gl_HitTEXT;
  hit.normal = back ? -normal : normal;
  hit.albedo = material.baseColor.rgb;
  hit.roughness = material.roughness;
  hit.metallic = material.metallic;
  uvec4 ids = objects.o[gl_InstanceID].segmentation;
  hit.emission = lensEmission(int(material.emission.x), int(bodyState(ids.y).x));
  hit.texture = int(material.emission.y);
  hit.pane = material.baseColor.a < 1.0;
  hit.snowless = material.emission.z > 0.5;
  hit.identity = ids.x;
  hit.material = instance.materialIndex;
  hit.plane = material.emission.w < 0.0 || isRoom(hit.texture) ? meshPlane(a, b, c, weights, hit.normal)
      : worldPlane(hit.texture, gl_WorldRayOriginEXT + gl_WorldRayDirectionEXT * gl_HitTEXT, hit.normal);
  return hit;
}
