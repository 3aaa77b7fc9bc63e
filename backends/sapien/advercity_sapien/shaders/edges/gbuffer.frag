#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "../raster/interface.glsl"

layout(location = 0) in vec3 inWorldNormal;
layout(location = 1) in float inDistance;
layout(location = 2) in flat int inNumber;

// x and y of the normal, depth with the sign of the normal's z, and the number of the surface.
layout(location = 0) out vec4 outEdge;

void main() {
  vec3 normal = normalize(inWorldNormal);
  outEdge = vec4(normal.xy, normal.z < 0.0 ? -inDistance : inDistance, float(inNumber));
}
