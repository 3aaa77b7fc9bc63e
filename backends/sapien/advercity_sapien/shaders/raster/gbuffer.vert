#version 450

#define CAMERA_SET 0
#define OBJECT_SET 1
#include "./interface.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;

// In few locations, since the software driver keeps each for every triangle.
layout(location = 0) out vec3 outWorldNormal;
layout(location = 0, component = 3) out float outDistance;
layout(location = 1) out vec3 outPosition;
layout(location = 2) out vec2 outUv;

void main() {
  vec4 placed = objectTransformBuffer.modelMatrix * vec4(position, 1.0);
  vec4 seen = cameraBuffer.viewMatrix * placed;
  outWorldNormal = mat3(objectTransformBuffer.modelMatrix) * normal;
  outDistance = -seen.z;
  outPosition = placed.xyz;
  outUv = uv;
  // Hidden bodies, such as the camera's own vehicle, still cast shadows: only this pass drops them.
  gl_Position = objectDataBuffer.hidden != 0
      ? vec4(0.0, 0.0, 2.0, 1.0) : cameraBuffer.projectionMatrix * seen;
}
