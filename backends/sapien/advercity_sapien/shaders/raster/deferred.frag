#version 450

#define SCENE_SET 0
#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 2, binding = 0) uniform sampler2D samplerAlbedo;
layout(set = 2, binding = 1) uniform sampler2D samplerNormal;
layout(set = 2, binding = 2) uniform sampler2D samplerDepthEmission;
layout(set = 2, binding = 3) uniform sampler2D samplerTable;
layout(set = 2, binding = 4) uniform sampler2D samplerSky;
layout(set = 2, binding = 5) uniform sampler2D samplerWear;

layout(location = 0) in vec2 inUV;
layout(location = 0) out vec4 outRadiance;

#include "../atmosphere.glsl"
#include "../surface.glsl"
#include "../lamps.glsl"
#include "../texture.glsl"

// Share of the sun that reaches a point, percentage-closer filtered over 3x3 texels.
float sunlit(vec3 position, vec3 normal) {
  if (NUM_DIRECTIONAL_LIGHT_SHADOWS == 0) return 1.0;
  LightView light = shadowBuffer.directionalLightBuffers[0];
  vec2 size = vec2(textureSize(samplerDirectionalLightDepths[0], 0));
  vec4 clip = light.projectionMatrix * light.viewMatrix * vec4(position, 1.0);
  float texel = 2.0 / (light.projectionMatrix[0][0] * size.x);
  clip = light.projectionMatrix * light.viewMatrix * vec4(position + normal * 2.0 * texel, 1.0);
  vec2 uv = clip.xy * 0.5 + 0.5;
  if (any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) return 1.0;
  float lit = 0.0;
  for (int i = 0; i < 9; ++i) {
    vec2 offset = vec2(i % 3 - 1, i / 3 - 1) / size;
    lit += step(clip.z, texture(samplerDirectionalLightDepths[0], uv + offset).x);
  }
  return lit / 9.0;
}

// Noise whose neighbours differ most (Jimenez 2014), in [0, 1).
float interleaved(vec2 pixel) {
  return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715))));
}

void main() {
  vec4 target = cameraBuffer.projectionMatrixInverse * vec4(inUV * 2.0 - 1.0, 0.5, 1.0);
  vec3 seen = target.xyz / -target.z;
  float stretch = length(seen);
  vec3 ray = mat3(cameraBuffer.viewMatrixInverse) * (seen / stretch);

  vec4 depthEmission = texture(samplerDepthEmission, inUV);
  float depth = depthEmission.x;
  vec3 eye = cameraBuffer.viewMatrixInverse[3].xyz;
  float distance = depth > 0.0 ? depth * stretch : 3000.0;
  vec3 glowing = glowOfLamps(eye, ray, distance, interleaved(gl_FragCoord.xy));
  if (depth <= 0.0) {
    outRadiance = vec4(sky(ray) + glowing, 0.0);
    return;
  }
  vec4 albedo = texture(samplerAlbedo, inUV);
  vec4 normal = texture(samplerNormal, inUV);
  vec3 position = eye + ray * distance;
  float pixelAngle = 2.0 / (cameraBuffer.projectionMatrix[0][0] * cameraBuffer.width);
  float wide = footprint(pixelAngle, distance, abs(dot(ray, normal.xyz)));
  albedo.rgb *= detail(int(depthEmission.z), position, normal.xyz, wide);

  Surface s = surface(albedo.rgb, albedo.a, normal.a, normal.xyz);
  vec3 sun = towardsSun();
  vec3 radiance = depthEmission.y * albedo.rgb;
  if (dot(sunIrradiance(), vec3(1.0)) > 0.0 && dot(normal.xyz, sun) > 0.0) {
    radiance += reflected(s, -ray, sun) * sunIrradiance() * sunlit(position, normal.xyz);
  }
  for (int i = 0; i < lampCount(); ++i) radiance += litBy(lamp(i), s, -ray, position);
  radiance += s.albedo * skyIrradiance(normal.xyz) / PI;
  if (s.specular.g > 1e-4) {
    vec3 mirror = reflect(ray, normal.xyz);
    vec3 around = mix(sky(mirror), skyIrradiance(mirror) / PI, sqrt(s.alpha));
    radiance += fresnel(s.specular, -dot(ray, normal.xyz)) * around;
  }
  outRadiance = vec4(throughAir(radiance, ray, distance) + glowing, depth);
}
