#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#define MATERIAL_SET 2
#include "../raster/interface.glsl"

// Whether a pane is before the surface, in all channels, as SAPIEN blends by alpha.
layout(location = 0) out vec4 outPaned;

void main() { outPaned = vec4(1.0); }
