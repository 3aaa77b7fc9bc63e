#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#include "../raster/interface.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;

void main() {
  vec4 seen = cameraBuffer.viewMatrix * objectTransformBuffer.modelMatrix * vec4(position, 1.0);
  gl_Position = objectDataBuffer.hidden != 0
      ? vec4(0.0, 0.0, 2.0, 1.0) : cameraBuffer.projectionMatrix * seen;
}
