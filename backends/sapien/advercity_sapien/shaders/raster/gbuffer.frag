#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "./interface.glsl"
#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../lamp_lenses.glsl"
#include "../sampling.glsl"
#include "../map_plane.glsl"
#define mapTone colorTexture
#define mapRelief normalTexture
#include "../material_maps.glsl"
#include "../rooms.glsl"
#include "./pixel_samples.glsl"
#include "./surface_number.glsl"

layout(location = 0) in vec3 inWorldNormal;
layout(location = 0, component = 3) in float inDistance;
layout(location = 1) in vec3 inPosition;
layout(location = 2) in vec2 inUv;

layout(location = 0) out vec4 outColour;
layout(location = 1) out vec4 outFacing;
// Depth, light of lamps, pattern of the material and whether snow stays off it, and the number of the
// surface: negative if its material has images.
layout(location = 2) out vec4 outDepthEmission;
layout(location = 3) out uvec4 outShape;
// Normal with the relief of images.
layout(location = 4) out vec4 outRelief;

void main() {
  vec3 normal = normalize(inWorldNormal);
  vec3 ray = inPosition - cameraBuffer.viewMatrixInverse[3].xyz;
  int kind = int(materialBuffer.emission.y);
  // Leaves have the normal of their crown, on the side that is seen.
  if (kind == TEXTURE_LEAVES) normal = faceforward(normal, ray, normal);
  vec3 relief = normal;
  bool mapped = (materialBuffer.textureMask & HAS_TONE) != 0;
  MapSample maps = NO_MAPS;
  if (mapped) {
    float width = materialBuffer.emission.w;
    MapPlane plane = width > 0.0 ? worldPlane(kind, inPosition, normal)
        : meshPlane(inUv, normal, dFdx(inPosition), dFdy(inPosition), dFdx(inUv), dFdy(inUv));
    float distance = length(ray);
    vec4 range = vec4(materialBuffer.fresnel, materialBuffer.ior,
        materialBuffer.transmissionRoughness, MAX_ROUGHNESS_RATIO);
    maps = sampleMaps(kind, abs(width), range, (materialBuffer.textureMask & HAS_RELIEF) != 0, plane,
        normal, ray / distance, pixelAngle() * distance);
    relief = reliefNormal(normal, plane, maps.slope);
  }
  vec3 albedo = materialBuffer.baseColor.rgb;
  float emission = lensEmission(int(materialBuffer.emission.x), objectDataBuffer.lit);
  if (isRoom(kind)) {
    MapPlane plane =
        meshPlane(inUv, normal, dFdx(inPosition), dFdy(inPosition), dFdx(inUv), dFdy(inUv));
    float distance = length(ray);
    albedo = roomAlbedo(kind, albedo, emission > 0.0, plane, normal, ray / distance,
        pixelAngle() * distance);
  }
  outColour = min(vec4(albedo, materialBuffer.roughness) * maps.tone, 1.0);
  outFacing = vec4(normal, materialBuffer.metallic);
  outRelief = vec4(relief, 0.0);
  int surface = surfaceNumber();
  outDepthEmission = vec4(
      inDistance, emission,
      materialBuffer.emission.z > 0.5 ? kind + SNOWLESS : kind, mapped ? -surface : surface);
  uint shape = objectDataBuffer.segmentation.x;
  outShape = uvec4(shape & 0xffffu, shape >> 16, 0u, 0u);
}
