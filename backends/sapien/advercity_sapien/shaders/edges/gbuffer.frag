#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "../raster/interface.glsl"
#include "../raster/surface_number.glsl"

layout(location = 0) in vec3 inWorldNormal;
layout(location = 0, component = 3) in float inDistance;

// x and y of the normal, depth with the sign of the normal's z, and the number of the surface.
layout(location = 0) out vec4 outEdge;
// No pane: SAPIEN only clears what this pass writes to, not what the next one, of panes, does.
layout(location = 1) out vec4 outPaned;

void main() {
  vec3 normal = normalize(inWorldNormal);
  outEdge = vec4(normal.xy, normal.z < 0.0 ? -inDistance : inDistance, float(surfaceNumber()));
  outPaned = vec4(0.0);
}
