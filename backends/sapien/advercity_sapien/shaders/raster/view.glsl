// Rays of the camera and what they meet far away; needs the camera's buffer and atmosphere.glsl.

// Unit ray through a place of the picture, and how much longer it is than its depth.
vec3 rayThrough(vec2 uv, out float stretch) {
  vec4 target = cameraBuffer.projectionMatrixInverse * vec4(uv * 2.0 - 1.0, 0.5, 1.0);
  vec3 seen = target.xyz / -target.z;
  stretch = length(seen);
  return mat3(cameraBuffer.viewMatrixInverse) * (seen / stretch);
}

// The sky as a mirror shows it whose lobe is as wide as `alpha`.
vec3 skyAround(vec3 ray, float alpha) {
  return mix(sky(ray), skyIrradiance(ray) / PI, sqrt(alpha));
}
