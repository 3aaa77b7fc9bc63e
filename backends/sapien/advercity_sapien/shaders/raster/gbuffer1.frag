#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "./interface.glsl"

layout(location = 0) in vec3 inWorldNormal;
layout(location = 0, component = 3) in float inDistance;

// Pane before other surfaces: x and y of its normal, depth with the sign of the normal's z, and 1,
// as SAPIEN blends by alpha.
layout(location = 0) out vec4 outPane;
layout(location = 1) out uvec4 outShape;

void main() {
  vec3 normal = normalize(inWorldNormal);
  outPane = vec4(normal.xy, normal.z < 0.0 ? -inDistance : inDistance, 1.0);
  uint shape = objectDataBuffer.segmentation.x;
  outShape = uvec4(shape & 0xffffu, shape >> 16, 0u, 0u);
}
