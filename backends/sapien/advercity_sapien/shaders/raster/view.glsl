// Rays of the camera; needs the camera's buffer.

// Unit ray through a point of the image, and the ratio of distance to depth along it.
vec3 rayThrough(vec2 uv, out float distancePerDepth) {
  vec4 target = cameraBuffer.projectionMatrixInverse * vec4(uv * 2.0 - 1.0, 0.5, 1.0);
  vec3 seen = target.xyz / -target.z;
  distancePerDepth = length(seen);
  return mat3(cameraBuffer.viewMatrixInverse) * (seen / distancePerDepth);
}
