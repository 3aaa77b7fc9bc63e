#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerLit;
layout(set = 0, binding = 1) uniform sampler2D samplerMirror;
layout(set = 0, binding = 2) uniform sampler2D samplerAlbedo;
layout(set = 0, binding = 3) uniform sampler2D samplerDepthEmission;
layout(set = 0, binding = 4) uniform sampler2D samplerTable;
layout(set = 0, binding = 5) uniform sampler2D samplerSky;
layout(set = 0, binding = 6) uniform sampler2D samplerAirlight;
layout(set = 0, binding = 7) uniform sampler2D samplerAmbient;

layout(location = 0) in vec2 inUV;
// Light that comes to the camera from what it sees, and depth.
layout(location = 0) out vec4 outSeen;
// Light of lamps that air scatters to it, dithered.
layout(location = 1) out vec4 outGlow;

#include "../atmosphere.glsl"
#include "../airlight.glsl"
#include "../surface.glsl"
#include "../lamps.glsl"
#include "./view.glsl"
#include "./dither.glsl"

const float FAR = 3000.0;

// Depth at a place of the picture; between a roof and the sky there is none in the middle.
ivec2 pixelAt(vec2 ndc) {
  ivec2 size = textureSize(samplerLit, 0);
  return clamp(ivec2((ndc * 0.5 + 0.5) * size), ivec2(0), size - 1);
}

float depthAt(vec2 ndc) { return texelFetch(samplerLit, pixelAt(ndc), 0).a; }

// Whether what a pixel shows stands out of the mirror, which shows no part of itself.
bool standsOut(vec2 ndc, float depth, vec3 position, vec3 normal) {
  float stretch;
  vec3 ray = rayThrough((vec2(pixelAt(ndc)) + 0.5) / vec2(textureSize(samplerLit, 0)), stretch);
  vec3 seen = cameraBuffer.viewMatrixInverse[3].xyz + ray * stretch * depth;
  return dot(seen - position, normal) > 0.03 + 2e-3 * depth;
}

// Where a ray from a place meets what the camera sees, as a place in the picture and 1, or 0 if it
// does not. Steps are even in the picture, where depth runs with its inverse.
vec3 metOnScreen(vec3 position, vec3 ray, vec3 normal) {
  const int STEPS = 20, HALVINGS = 4;
  const float LONGEST = 120.0, NEAR = 0.2;
  vec3 start = (cameraBuffer.viewMatrix * vec4(position, 1.0)).xyz;
  vec3 along = mat3(cameraBuffer.viewMatrix) * ray;
  float reach = along.z > 0.0 ? min(LONGEST, (-NEAR - start.z) / along.z) : LONGEST;
  vec4 clip0 = cameraBuffer.projectionMatrix * vec4(start, 1.0);
  vec4 clip1 = cameraBuffer.projectionMatrix * vec4(start + along * reach, 1.0);
  vec3 from = vec3(clip0.xy / clip0.w, 1.0 / clip0.w);
  vec3 way = vec3(clip1.xy / clip1.w, 1.0 / clip1.w) - from;
  vec2 exits = (sign(way.xy) - from.xy) / (way.xy + vec2(equal(way.xy, vec2(0.0))));
  way *= clamp(min(way.x == 0.0 ? 1.0 : exits.x, way.y == 0.0 ? 1.0 : exits.y), 0.0, 1.0);
  float before = 0.0, depthBefore = clip0.w;
  for (int i = 1; i <= STEPS; ++i) {
    float share = float(i) / float(STEPS);
    vec3 here = from + way * share;
    float depth = 1.0 / here.z;
    float seen = depthAt(here.xy);
    float behind = depth - seen;
    if (seen > 0.0 && behind > 0.0 && behind < 1.0 + 1.5 * abs(depth - depthBefore)
        && standsOut(here.xy, seen, position, normal)) {
      float after = share;
      for (int k = 0; k < HALVINGS; ++k) {
        float middle = 0.5 * (before + after);
        here = from + way * middle;
        seen = depthAt(here.xy);
        if (seen > 0.0 && 1.0 / here.z > seen) after = middle;
        else before = middle;
      }
      return vec3((from + way * after).xy * 0.5 + 0.5, 1.0);
    }
    before = share;
    depthBefore = depth;
  }
  return vec3(0.0);
}

// What a level mirror shows: the picture where it can, else the sky. A rough one smears it up and
// down, as wet asphalt does.
vec3 reflection(vec3 position, vec3 ray, vec3 normal, float alpha, float distance) {
  const int TAPS = 5;
  vec3 mirror = reflect(ray, normal);
  if (mirror.z <= 0.0) return airlight(mirror).rgb;
  vec3 around = skyAround(mirror, alpha);
  vec3 met = metOnScreen(position, mirror, normal);
  if (met.z == 0.0) return around;
  float stretch;
  rayThrough(met.xy, stretch);
  float beyond = max(depthAt(met.xy * 2.0 - 1.0) * stretch, distance) - distance;
  float smear = alpha * 0.5 * cameraBuffer.projectionMatrix[1][1] * beyond / (distance + beyond);
  vec3 sum = vec3(0.0);
  for (int i = 0; i < TAPS; ++i) {
    float off = (float(i) + 0.5) / float(TAPS) * 2.0 - 1.0;
    sum += textureLod(samplerLit, clamp(met.xy + vec2(0.0, off * smear), 0.0, 1.0), 0.0).rgb;
  }
  vec2 edge = smoothstep(vec2(0.0), vec2(0.05), 0.5 - abs(met.xy - 0.5));
  return mix(around, throughAir(sum / float(TAPS), mirror, beyond), edge.x * edge.y);
}

// What the sky's light gives more than `lit` has, with the openness of all dithered pixels that are
// of the same surface.
vec3 smoothAmbient(float depth) {
  const float ALIKE = 0.03;
  vec4 own = texture(samplerAmbient, inUV);
  ivec2 first = dithered(gl_FragCoord.xy, textureSize(samplerAmbient, 0));
  float sum = 0.0, weight = 0.0;
  for (int i = 0; i < DITHER * DITHER; ++i) {
    ivec2 texel = first + ivec2(i % DITHER, i / DITHER);
    float off = abs(texelFetch(samplerLit, texel, 0).a - depth);
    float alike = max(1.0 - off / (ALIKE * depth), 0.0);
    sum += alike * texelFetch(samplerAmbient, texel, 0).a;
    weight += alike;
  }
  return weight > 0.0 ? own.rgb * (sum / weight - own.a) : vec3(0.0);
}

void main() {
  float stretch;
  vec3 ray = rayThrough(inUV, stretch);
  vec3 eye = cameraBuffer.viewMatrixInverse[3].xyz;
  vec4 lit = texture(samplerLit, inUV);
  float depth = lit.a;
  float distance = depth > 0.0 ? depth * stretch : FAR;
  vec3 glowing = glowOfLamps(inUV, eye, ray, distance, dither(gl_FragCoord.xy));
  outGlow = vec4(glowing, 0.0);
  if (depth <= 0.0) {
    outSeen = vec4(lit.rgb, 0.0);
    return;
  }
  vec3 radiance = lit.rgb;
  if (!night()) radiance += smoothAmbient(depth);
  vec4 mirror = texture(samplerMirror, inUV);
  if (mirror.z > 0.0) {
    vec3 normal = vec3(mirror.xy, sqrt(max(1.0 - dot(mirror.xy, mirror.xy), 0.0)));
    radiance += mirror.z * reflection(eye + ray * distance, ray, normal, mirror.w, distance);
  }
  if (night()) {
    float emission = texture(samplerDepthEmission, inUV).y;
    if (emission > 0.0) radiance += emission * texture(samplerAlbedo, inUV).rgb;
  }
  outSeen = vec4(throughAir(radiance, ray, distance), depth);
}
