#version 450

#define SCENE_SET 0
#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 2, binding = 0) uniform sampler2D samplerColour;
layout(set = 2, binding = 1) uniform sampler2D samplerFacing;
layout(set = 2, binding = 2) uniform sampler2D samplerDepthEmission;
layout(set = 2, binding = 3) uniform sampler2D samplerTable;
layout(set = 2, binding = 4) uniform sampler2D samplerSky;
layout(set = 2, binding = 5) uniform sampler2D samplerWear;
layout(set = 2, binding = 6) uniform sampler2D samplerPuddles;
layout(set = 2, binding = 7) uniform sampler2D samplerShelter;
layout(set = 2, binding = 8) uniform sampler2D samplerProbeLight;
layout(set = 2, binding = 9) uniform sampler2D samplerProbeFirst;
layout(set = 2, binding = 10) uniform sampler2D samplerProbeSecond;
layout(set = 2, binding = 11) uniform sampler2D samplerContact;
layout(set = 2, binding = 12) uniform sampler2D samplerRelief;
layout(set = 2, binding = 13) uniform sampler2D samplerLampReach;
layout(set = 2, binding = 14) uniform sampler2D samplerAirlight;
layout(set = 2, binding = 15) uniform sampler2D samplerSkylineLight;
layout(set = 2, binding = 16) uniform sampler2D samplerSkylineNearness;

// Radiance of surfaces, without the air before them, and depth.
layout(location = 0) out vec4 outLit;
// Mirror reflections of level surfaces: x and y of the normal, reflectance, and width of the lobe.
layout(location = 1) out vec4 outMirror;
// Reflected sky light without occlusion, and ambient occlusion, dithered.
layout(location = 2) out vec4 outAmbient;

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../shader_table.glsl"
#include "../atmosphere.glsl"
#include "../airlight.glsl"
#include "../surface.glsl"
#include "../sampling.glsl"
#include "../texture.glsl"
#include "../ground.glsl"
#include "../deflection.glsl"
#include "../lamps.glsl"
#include "./lamp_shadows.glsl"
#include "./pixel_samples.glsl"
#include "./seen_surfaces.glsl"
#include "./view.glsl"
#include "./dither.glsl"
#include "./ambient_occlusion.glsl"
#include "./light_probes.glsl"
#include "./skylines.glsl"

// Fraction of the sun that is visible from a point: the mean over a square of 3x3 texels around it in
// the finest shadow map that has it. Of the 4x4 that it covers, the outer ones count by their part.
float sunVisibility(vec3 position, vec3 normal) {
  for (int map = 0; map < NUM_DIRECTIONAL_LIGHT_SHADOWS; ++map) {
    LightView light = shadowBuffer.directionalLightBuffers[map];
    vec2 size = vec2(textureSize(samplerDirectionalLightDepths[map], 0));
    float texel = 2.0 / (light.projectionMatrix[0][0] * size.x);
    vec4 clip = light.projectionMatrix * light.viewMatrix * vec4(position + normal * 2.0 * texel, 1.0);
    vec2 uv = clip.xy * 0.5 + 0.5;
    if (any(lessThan(uv, 2.0 / size)) || any(greaterThan(uv, 1.0 - 2.0 / size))) continue;
    vec2 corner = floor(uv * size - 0.5), part = uv * size - 0.5 - corner;
    float lit = 0.0;
    for (int i = 0; i < 4; ++i) {
      vec2 pair = vec2(i % 2, i / 2);
      vec4 depths = textureGather(samplerDirectionalLightDepths[map], (corner + 2.0 * pair) / size);
      vec2 first = mix(1.0 - part, vec2(1.0), pair), second = mix(vec2(1.0), part, pair);
      // The order of a gather: counterclockwise from the second row's first texel.
      vec4 covered = vec4(first.x, second.xx, first.x) * vec4(second.yy, first.yy);
      lit += dot(covered, step(clip.zzzz, depths));
    }
    return lit / 9.0;
  }
  return 1.0;
}

// Radiance of a surface by the lamps of its cell, and those that it mirrors; `normal` is that of its
// plane.
vec3 lampRadiance(Surface s, vec3 towardsEye, vec3 position, vec3 normal) {
  // A point lamp in a perfect mirror would fall between pixels, or be far too bright in one.
  s.alpha = max(s.alpha, 0.05);
  vec3 sum = vec3(0.0);
  // The road reflects hardly any light to what is level.
  bool mirrors = isMirrorLike(s), byRoad = s.normal.z < 0.7;
  float coatLeaves = coatTransmittance(s, dot(s.normal, towardsEye));
  ivec2 cell = cellList(position.xy);
  for (int i = cell.x; i < cell.y; ++i) {
    ivec4 four = lampQuad(CELL_LAMPS_ROW, i);
    for (; four.x >= 0; four = ivec4(four.yzw, -1)) {
      if (!mayLight(four.x, position, s.normal)) continue;
      Lamp l = fetchLamp(four.x);
      vec3 light = lampReflection(l, s, towardsEye, coatLeaves, position, mirrors, byRoad);
      if (light != vec3(0.0)) sum += light * lampVisibility(l, position, normal);
    }
  }
  if (!mirrors) return sum;
  int list = bearingList(-towardsEye.xy);
  for (int i = 0; i < TEXELS_PER_BEARING; ++i) {
    ivec4 four = lampQuad(BEARINGS_ROW, list + i);
    for (int j = 0; j < 4 && four[j] >= 0; ++j) {
      Lamp l = fetchLamp(four[j]);
      vec3 light = lampMirrorReflection(l, s, towardsEye, position);
      if (light != vec3(0.0)) sum += light * lampVisibility(l, position, normal);
    }
    if (four.w < 0) break;
  }
  return sum;
}

// Whether an adjacent middle of a pixel shows the same surface as a sample.
bool hasLightOfMiddle(ivec2 texel) {
  SeenSurface seen = surfaceAt(texel);
  for (int i = 0; i < 4; ++i) {
    if (similarity(seen, surfaceAt(adjacentMiddle(texel, i))) > 0.0) return true;
  }
  return false;
}

void main() {
  ivec2 texel = surfaceTexel(wholeNumber(floor(gl_FragCoord.xy)));
  if (withinPixel(texel) != ivec2(0) && hasLightOfMiddle(texel)) {
    outLit = vec4(0.0, 0.0, 0.0, NO_LIGHT);
    return;
  }
  vec2 place = imagePlace(texel);
  float distancePerDepth;
  vec3 ray = rayThrough(place, distancePerDepth);
  vec4 depthEmission = texelFetch(samplerDepthEmission, texel, 0);
  float depth = depthEmission.x;
  outMirror = vec4(0.0);
  outAmbient = vec4(0.0);
  if (depth <= 0.0) {
    outLit = vec4(sky(ray), 0.0);
    return;
  }
  vec4 albedo = texelFetch(samplerColour, texel, 0);
  vec4 normal = texelFetch(samplerFacing, texel, 0);
  float distance = depth * distancePerDepth;
  vec3 position = cameraBuffer.viewMatrixInverse[3].xyz + ray * distance;
  float pixelWidth = footprint(pixelAngle(), distance, abs(dot(ray, normal.xyz)));
  int pattern = wholeNumber(depthEmission.z), kind = pattern % SNOWLESS;
  vec3 radiance = isNight() ? vec3(0.0) : depthEmission.y * albedo.rgb;
  vec3 relief = texelFetch(samplerRelief, texel, 0).xyz;
  albedo.rgb *= materialDetail(kind, depthEmission.w < 0.0, position, normal.xyz, pixelWidth);

  Surface s = buildSurface(albedo.rgb, albedo.a, normal.a, kind, pattern >= SNOWLESS,
      position, normal.xyz, relief, pixelWidth);
  vec3 sun = sunDirection();
  if (dot(sunIrradiance(), vec3(1.0)) > 0.0 && (dot(s.normal, sun) > 0.0 || s.through > 0.0)) {
    // A leaf does not shade its own back.
    vec3 outward = s.through > 0.0 ? sun : normal.xyz;
    radiance += brdfCosine(s, -ray, sun) * sunIrradiance() * sunVisibility(position, outward);
  }
  if (isNight()) {
    fetchLampAir();
    // Invisible through the air before it, that is.
    negligibleRadiance /= max(unscatteredTransmittance(distance), 1e-3);
    float gain = deflectsVisibly() ? 1.0 : undeflectedGain(distance);
    radiance += gain * lampRadiance(s, -ray, position, normal.xyz);
  }
  float cosine = -dot(ray, s.normal);
  vec3 fromSky = skyIrradiance(s.normal);
  if (s.through > 0.0) fromSky += s.through * skyIrradiance(-s.normal);
  ProbeLight probe = probeLight(position, normal.xyz);
  vec3 ambient = s.albedo * coatTransmittance(s, cosine) * fromSky / PI
      * irradianceRatio(probe, normal.xyz);
  // In the dark hardly any light is from the sky, so its occlusion is not worth the time.
  float occlusion = isDark() ? 1.0
      : ambientOcclusion(place, depth, normal.xyz, s.through > 0.0, gl_FragCoord.xy);
  outAmbient = vec4(ambient, occlusion);
  radiance += ambient * occlusion;
  vec3 mirrored = fresnelReflectance(s, roughCosine(s.alpha, cosine));
  if (s.normal.z > 0.7 && s.alpha < 0.5 && s.coat > 0.0 && mirrored.g > 0.01) {
    outMirror = vec4(s.normal.xy, mirrored.g * mirrorsSky(position), s.alpha);
  } else if (mirrored.g > 0.0) {
    radiance += mirrored * mirroredLobe(probe, lobeMiddle(ray, s.normal, s.alpha), s.alpha);
  }
  outLit = vec4(radiance, depth);
}
