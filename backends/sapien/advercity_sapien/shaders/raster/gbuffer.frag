#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "./interface.glsl"
#include "../shader_constants.glsl"
#include "../lamp_lenses.glsl"
#include "../sampling.glsl"
#define mapTone colorTexture
#define mapRelief normalTexture
#include "../material_maps.glsl"

layout(location = 0) in vec3 inWorldNormal;
layout(location = 1) in float inDistance;
layout(location = 2) in flat uvec4 inIds;
layout(location = 3) in vec3 inPosition;
layout(location = 4) in vec2 inUv;

layout(location = 0) out vec4 outAlbedo;
layout(location = 1) out vec4 outNormal;
layout(location = 2) out vec4 outDepthEmission;
layout(location = 3) out uvec4 outSegmentation;
// Normal with the relief of images, and whether the material has any.
layout(location = 4) out vec4 outRelief;

MapSample sampleMaterial(vec3 normal) {
  if ((materialBuffer.textureMask & HAS_TONE) == 0) return NO_MAPS;
  vec3 ray = inPosition - cameraBuffer.viewMatrixInverse[3].xyz;
  float distance = length(ray);
  float pixelAngle = 2.0 / (cameraBuffer.projectionMatrix[0][0] * cameraBuffer.width);
  return sampleMaps(int(materialBuffer.emission.y), materialBuffer.emission.w,
      (materialBuffer.textureMask & HAS_RELIEF) != 0, inUv, inPosition, normal, ray / distance,
      pixelAngle * distance);
}

void main() {
  vec3 normal = normalize(inWorldNormal);
  MapSample maps = sampleMaterial(normal);
  outAlbedo = vec4(materialBuffer.baseColor.rgb * maps.tone.rgb,
      min(materialBuffer.roughness * maps.tone.a, 1.0));
  outNormal = vec4(normal, materialBuffer.metallic);
  outRelief = vec4(reliefNormal(normal, maps.slope), materialBuffer.textureMask & HAS_TONE);
  outDepthEmission = vec4(
      inDistance, lensEmission(int(materialBuffer.emission.x), objectDataBuffer.lit),
      materialBuffer.emission.y, materialBuffer.emission.z);
  outSegmentation = inIds;
}
