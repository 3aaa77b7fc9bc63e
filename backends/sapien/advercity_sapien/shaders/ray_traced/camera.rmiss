#version 460
#extension GL_EXT_ray_tracing : require

#include "./path.glsl"

layout(location = 0) rayPayloadInEXT Path path;

// The box of the sky is around everything, so only a ray from outside of it comes here.
void main() {
  path.hasEnded = true;
  path.isDeflected = false;
}
