#version 460
#extension GL_EXT_ray_tracing : require

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../sampling.glsl"
#include "../map_plane.glsl"
#include "./ray_hit.glsl"

layout(location = 0) rayPayloadInEXT RayHit hit;

void main() {
  hit.distance = -1.0;
}
