// Buffers that SAPIEN gives to a ray-tracing pack; it finds them by name.

struct GeometryInstance {
  uint geometryIndex;
  uint materialIndex;
  int padding0;
  int padding1;
};

struct Material {
  vec4 emission;
  vec4 baseColor;
  float fresnel;
  float roughness;
  float metallic;
  float transmission;
  float ior;
  float transmissionRoughness;
  int textureMask;
  int padding1;
  vec4 textureTransforms[6];
};

struct TextureIndex {
  int diffuse;
  int metallic;
  int roughness;
  int emission;
  int normal;
  int transmission;
  int occlusion;
  int padding0;
};

struct Vertex {
  float x, y, z;
  float nx, ny, nz;
  float u, v;
};

struct Object {
  uvec4 segmentation;
  float transparency;
  int shadeFlat;
  int padding0;
  int padding1;
};

struct PointLight { vec3 position; float radius; vec3 rgb; float padding; };
struct DirectionalLight { vec3 direction; float softness; vec3 rgb; float padding; };
struct SpotLight {
  mat4 viewMat;
  mat4 projMat;
  vec3 rgb;
  int padding0;
  vec3 position;
  int padding1;
  float fovInner;
  float fovOuter;
  int textureId;
  int padding2;
};
struct ParallelogramLight {
  vec3 rgb;
  float padding0;
  vec3 position;
  float padding1;
  vec3 edge0;
  float padding2;
  vec3 edge1;
  float padding3;
};

layout(set = 1, binding = 0) uniform accelerationStructureEXT tlas;
layout(set = 1, binding = 1) readonly buffer GeometryInstances { GeometryInstance i[]; } geometryInstances;
layout(set = 1, binding = 2) readonly buffer Materials { Material m; } materials[];
layout(set = 1, binding = 3) readonly buffer TextureIndices { TextureIndex t[]; } textureIndices;
layout(set = 1, binding = 4) uniform sampler2D textures[];
layout(set = 1, binding = 5) readonly buffer PointLights { PointLight l[]; } pointLights;
layout(set = 1, binding = 6) readonly buffer DirectionalLights { DirectionalLight l[]; } directionalLights;
layout(set = 1, binding = 7) readonly buffer SpotLights { SpotLight l[]; } spotLights;
layout(std430, set = 1, binding = 8) readonly buffer Vertices { Vertex v[]; } vertices[];
layout(set = 1, binding = 9) readonly buffer Indices { uint i[]; } indices[];
layout(set = 1, binding = 10) readonly buffer Objects { Object o[]; } objects;
layout(set = 1, binding = 11) readonly buffer ParallelogramLights { ParallelogramLight l[]; } parallelogramLights;
