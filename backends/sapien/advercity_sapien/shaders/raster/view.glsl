// Rays of the camera, and the sky as mirrors show it; needs the camera's buffer, atmosphere.glsl.

// Unit ray through a point of the image, and the ratio of distance to depth along it.
vec3 rayThrough(vec2 uv, out float distancePerDepth) {
  vec4 target = cameraBuffer.projectionMatrixInverse * vec4(uv * 2.0 - 1.0, 0.5, 1.0);
  vec3 seen = target.xyz / -target.z;
  distancePerDepth = length(seen);
  return mat3(cameraBuffer.viewMatrixInverse) * (seen / distancePerDepth);
}

// Radiance of the sky in a mirror whose lobe has the width `alpha`: between sky and mean.
vec3 skyLobe(vec3 ray, float alpha) {
  return mix(sky(ray), skyIrradiance(ray) / PI, sqrt(alpha));
}
