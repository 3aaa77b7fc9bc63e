#version 450

#define LIGHT_SET 0
#define OBJECT_SET 1
#include "./interface.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;

void main() {
  gl_Position = lightBuffer.projectionMatrix * lightBuffer.viewMatrix
      * objectTransformBuffer.modelMatrix * vec4(position, 1.0);
}
