// Buffers that SAPIEN gives to every pass; it finds them by name, and reads members by offset.

#ifdef CAMERA_SET
layout(set = CAMERA_SET, binding = 0) uniform CameraBuffer {
  mat4 viewMatrix;
  mat4 projectionMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrixInverse;
  float width;
  float height;
} cameraBuffer;
#endif

#ifdef OBJECT_SET
layout(set = OBJECT_SET, binding = 0) uniform ObjectTransformBuffer {
  mat4 modelMatrix;
} objectTransformBuffer;

layout(set = OBJECT_SET, binding = 1) uniform ObjectDataBuffer {
  uvec4 segmentation;
  float transparency;
  int shadeFlat;
  int lit;
  int hidden;
  int staticMesh;
} objectDataBuffer;
#endif

#ifdef MATERIAL_SET
layout(set = MATERIAL_SET, binding = 0) uniform MaterialBuffer {
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
} materialBuffer;

layout(set = MATERIAL_SET, binding = 1) uniform sampler2D colorTexture;
layout(set = MATERIAL_SET, binding = 2) uniform sampler2D roughnessTexture;
layout(set = MATERIAL_SET, binding = 3) uniform sampler2D normalTexture;
layout(set = MATERIAL_SET, binding = 4) uniform sampler2D metallicTexture;
layout(set = MATERIAL_SET, binding = 5) uniform sampler2D emissionTexture;
layout(set = MATERIAL_SET, binding = 6) uniform sampler2D transmissionTexture;
#endif

#if defined(SCENE_SET) || defined(LIGHT_SET)
struct LightView {
  mat4 viewMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrix;
  mat4 projectionMatrixInverse;
  int width;
  int height;
};
#endif

#ifdef LIGHT_SET
layout(set = LIGHT_SET, binding = 0) uniform LightBuffer {
  mat4 viewMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrix;
  mat4 projectionMatrixInverse;
  int width;
  int height;
} lightBuffer;
#endif

#ifdef SCENE_SET
layout(constant_id = 0) const int NUM_DIRECTIONAL_LIGHTS = 1;
layout(constant_id = 1) const int NUM_POINT_LIGHTS = 1;
layout(constant_id = 2) const int NUM_DIRECTIONAL_LIGHT_SHADOWS = 1;
layout(constant_id = 3) const int NUM_POINT_LIGHT_SHADOWS = 1;
layout(constant_id = 4) const int NUM_TEXTURED_LIGHT_SHADOWS = 1;
layout(constant_id = 5) const int NUM_SPOT_LIGHT_SHADOWS = 1;
layout(constant_id = 6) const int NUM_SPOT_LIGHTS = 1;

struct PointLight { vec4 position; vec4 emission; };
struct DirectionalLight { vec4 direction; vec4 emission; };
struct SpotLight { vec4 position; vec4 direction; vec4 emission; };

layout(set = SCENE_SET, binding = 0) uniform SceneBuffer {
  vec4 ambientLight;
  DirectionalLight directionalLights[2];
  SpotLight spotLights[1];
  PointLight pointLights[1];
  SpotLight texturedLights[1];
} sceneBuffer;

// Packs that draw no shadow maps may not have them.
#ifndef NO_SHADOWS
layout(set = SCENE_SET, binding = 1) uniform ShadowBuffer {
  LightView directionalLightBuffers[2];
  LightView spotLightBuffers[1];
  LightView pointLightBuffers[6];
  LightView texturedLightBuffers[1];
} shadowBuffer;

layout(set = SCENE_SET, binding = 2) uniform samplerCube samplerPointLightDepths[1];
layout(set = SCENE_SET, binding = 3) uniform sampler2D samplerDirectionalLightDepths[2];
layout(set = SCENE_SET, binding = 4) uniform sampler2D samplerTexturedLightDepths[1];
layout(set = SCENE_SET, binding = 5) uniform sampler2D samplerSpotLightDepths[1];
layout(set = SCENE_SET, binding = 6) uniform sampler2D samplerTexturedLightTextures[1];
#endif
#endif
