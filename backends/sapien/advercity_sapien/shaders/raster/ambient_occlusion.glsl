// Fraction of the sky's light that close surfaces leave to a point, estimated from the depth of the
// image: it is darker under vehicles, at the foot of walls and in crowns of trees.
// Needs the camera's buffer, samplerDepthEmission, pixel_samples.glsl and dither.glsl.

// Position in the camera's axes of a point of the image.
vec3 viewPosition(vec2 uv, float depth) {
  vec2 slope = (uv * 2.0 - 1.0 + cameraBuffer.projectionMatrix[2].xy)
      / vec2(cameraBuffer.projectionMatrix[0][0], cameraBuffer.projectionMatrix[1][1]);
  return vec3(slope, -1.0) * depth;
}

float ambientOcclusion(vec2 uv, float depth, vec3 worldNormal, bool isLeaf, vec2 pixel) {
  const int TAPS = 8;
  const float RADIUS = 1.6, GOLDEN_ANGLE = 2.39996;  // metres; radians
  // Surfaces up to FLAT above the horizon do not count: they are the same one, slightly curved.
  const float FLAT = 0.12, STRENGTH = 3.2, DARKEST = 0.2;
  // A surface below hides ground, but reflects about as much; what leaves hide is dark leaves.
  const float LEVEL = 0.2;
  const float WIDEST = 0.2, NARROWEST = 2.0;  // fraction of the image's height; pixels
  vec2 spread = 0.5 * RADIUS / depth
      * vec2(cameraBuffer.projectionMatrix[0][0], abs(cameraBuffer.projectionMatrix[1][1]));
  spread *= min(1.0, WIDEST / spread.y);
  ivec2 size = textureSize(samplerDepthEmission, 0);
  if (spread.y * float(pixelCount().y) < NARROWEST) return 1.0;
  vec3 up = mat3(cameraBuffer.viewMatrix)[2];
  vec3 point = viewPosition(uv, depth), normal = mat3(cameraBuffer.viewMatrix) * worldNormal;
  float rotation = dither(pixel) * 2.0 * PI, hidden = 0.0;
  for (int i = 0; i < TAPS; ++i) {
    float angle = rotation + float(i) * GOLDEN_ANGLE;
    float radius = sqrt((float(i) + 0.5) / float(TAPS));
    vec2 at = uv + spread * radius * vec2(cos(angle), sin(angle));
    ivec2 texel = wholeNumber(floor(at * vec2(size)));
    if (any(lessThan(texel, ivec2(0))) || any(greaterThanEqual(texel, size))) continue;
    float sampleDepth = texelFetch(samplerDepthEmission, texel, 0).x;
    if (sampleDepth <= 0.0) continue;
    vec3 offset = viewPosition((vec2(texel) + 0.5) / vec2(size), sampleDepth) - point;
    float far2 = dot(offset, offset);
    float above = dot(offset, normal) * inversesqrt(max(far2, 1e-8)) - FLAT;
    float rise = isLeaf ? 1.0 : dot(offset, up) * inversesqrt(max(far2, 1e-8));
    hidden += max(above, 0.0) * max(1.0 - far2 / (RADIUS * RADIUS), 0.0)
        * smoothstep(-LEVEL, LEVEL, rise);
  }
  return max(1.0 - STRENGTH / float(TAPS) * hidden, DARKEST);
}
