#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "./interface.glsl"

layout(location = 0) in vec3 inWorldNormal;
layout(location = 1) in float inDistance;
layout(location = 2) in flat uvec4 inIds;

// Pane before other surfaces: x and y of its normal, depth with the sign of the normal's z, and 1,
// as SAPIEN blends by alpha.
layout(location = 0) out vec4 outPane;
layout(location = 1) out uvec4 outShape;

void main() {
  vec3 normal = normalize(inWorldNormal);
  outPane = vec4(normal.xy, normal.z < 0.0 ? -inDistance : inDistance, 1.0);
  outShape = uvec4(inIds.x & 0xffffu, inIds.x >> 16, 0u, 0u);
}
