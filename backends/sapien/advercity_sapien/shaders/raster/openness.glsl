// Share of the sky's light that things close by leave to a place, by what the picture itself shows
// of them: it is darker under vehicles, at the foot of walls and in crowns of trees.
// Needs the camera's buffer, samplerDepthEmission, and dither.glsl.

vec3 placeInView(vec2 uv, float depth) {
  vec2 slope = (uv * 2.0 - 1.0)
      / vec2(cameraBuffer.projectionMatrix[0][0], cameraBuffer.projectionMatrix[1][1]);
  return vec3(slope, -1.0) * depth;
}

float openness(vec2 uv, float depth, vec3 worldNormal, vec2 pixel) {
  const int TAPS = 8;
  const float REACH = 1.6, GOLDEN = 2.39996, FLAT = 0.12, STRENGTH = 3.2, DARKEST = 0.2;
  const float WIDEST = 0.2, NARROWEST = 2.0;
  vec2 spread = 0.5 * REACH / depth
      * vec2(cameraBuffer.projectionMatrix[0][0], abs(cameraBuffer.projectionMatrix[1][1]));
  spread *= min(1.0, WIDEST / spread.y);
  ivec2 size = textureSize(samplerDepthEmission, 0);
  if (spread.y * float(size.y) < NARROWEST) return 1.0;
  vec3 here = placeInView(uv, depth), normal = mat3(cameraBuffer.viewMatrix) * worldNormal;
  float turn = dither(pixel) * 2.0 * PI, hidden = 0.0;
  for (int i = 0; i < TAPS; ++i) {
    float angle = turn + float(i) * GOLDEN;
    float radius = sqrt((float(i) + 0.5) / float(TAPS));
    vec2 at = uv + spread * radius * vec2(cos(angle), sin(angle));
    ivec2 texel = ivec2(at * vec2(size));
    if (any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, size))) continue;
    float there = texelFetch(samplerDepthEmission, texel, 0).x;
    if (there <= 0.0) continue;
    vec3 way = placeInView((vec2(texel) + 0.5) / vec2(size), there) - here;
    float far2 = dot(way, way);
    float above = dot(way, normal) * inversesqrt(max(far2, 1e-8)) - FLAT;
    hidden += max(above, 0.0) * max(1.0 - far2 / (REACH * REACH), 0.0);
  }
  return max(1.0 - STRENGTH / float(TAPS) * hidden, DARKEST);
}
