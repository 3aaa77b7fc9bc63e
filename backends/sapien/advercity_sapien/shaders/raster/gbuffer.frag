#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "./interface.glsl"
#include "../shader_constants.glsl"
#include "../lamp_lenses.glsl"

layout(location = 0) in vec3 inWorldNormal;
layout(location = 1) in float inDistance;
layout(location = 2) in flat uvec4 inIds;

layout(location = 0) out vec4 outAlbedo;
layout(location = 1) out vec4 outNormal;
layout(location = 2) out vec4 outDepthEmission;
layout(location = 3) out uvec4 outSegmentation;

void main() {
  outAlbedo = vec4(materialBuffer.baseColor.rgb, materialBuffer.roughness);
  outNormal = vec4(normalize(inWorldNormal), materialBuffer.metallic);
  outDepthEmission = vec4(
      inDistance, lensEmission(int(materialBuffer.emission.x), objectDataBuffer.lit),
      materialBuffer.emission.y, materialBuffer.emission.z);
  outSegmentation = inIds;
}
