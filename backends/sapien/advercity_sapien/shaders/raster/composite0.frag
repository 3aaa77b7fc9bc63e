#version 450

#define CAMERA_SET 1
#include "./interface.glsl"

layout(set = 0, binding = 0) uniform sampler2D samplerLit;
layout(set = 0, binding = 1) uniform sampler2D samplerMirror;
layout(set = 0, binding = 2) uniform sampler2D samplerColour;
layout(set = 0, binding = 3) uniform sampler2D samplerDepthEmission;
layout(set = 0, binding = 4) uniform sampler2D samplerTable;
layout(set = 0, binding = 5) uniform sampler2D samplerSky;
layout(set = 0, binding = 6) uniform sampler2D samplerAirlight;
layout(set = 0, binding = 7) uniform sampler2D samplerAmbient;
layout(set = 0, binding = 8) uniform sampler2D samplerLampReach;
layout(set = 0, binding = 9) uniform sampler2D samplerPane;
layout(set = 0, binding = 10) uniform sampler2D samplerProbeLight;
layout(set = 0, binding = 11) uniform sampler2D samplerProbeFirst;
layout(set = 0, binding = 12) uniform sampler2D samplerProbeSecond;
layout(set = 0, binding = 13) uniform sampler2D samplerContact;
layout(set = 0, binding = 14) uniform sampler2D samplerSkylineLight;
layout(set = 0, binding = 15) uniform sampler2D samplerSkylineNearness;

// Radiance of the surfaces that the camera sees, through air, and depth.
layout(location = 0) out vec4 outSeen;
// Dithered: what level surfaces mirror. Last, whether this one does: some samples of a pattern may have
// nothing.
layout(location = 1) out vec4 outReflex;
// Dithered, of every second pixel of every second row, side by side: light of lamps that air scatters
// towards the camera. Last, the depth, negative if fog deflects light visibly. To the right of it light that
// is deflected (spread_light.glsl). All is 0 where no lamps glow.
layout(location = 2) out vec4 outGlow;

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../shader_table.glsl"
#include "../atmosphere.glsl"
#include "../airlight.glsl"
#include "../surface.glsl"
#include "../deflection.glsl"
#include "../lamps.glsl"
#include "./lamp_shadows.glsl"
#include "./pixel_samples.glsl"
#include "./spread_light.glsl"
#include "./view.glsl"
#include "./dither.glsl"
#include "./light_probes.glsl"
#include "./skylines.glsl"

// Depth at a point; unfiltered, as there is none between a roof and the sky.
float depthAt(vec2 ndc) { return texelFetch(samplerLit, pixelAt(ndc * 0.5 + 0.5), 0).a; }

// Whether the surface of a pixel lies in front of the mirror's plane: a mirror does not show itself.
bool isInFrontOfMirror(vec2 ndc, float depth, vec3 position, vec3 normal) {
  float distancePerDepth;
  vec3 ray = rayThrough(imagePlace(surfaceTexel(pixelAt(ndc * 0.5 + 0.5))), distancePerDepth);
  vec3 seen = cameraBuffer.viewMatrixInverse[3].xyz + ray * distancePerDepth * depth;
  return dot(seen - position, normal) > 0.03 + 2e-3 * depth;
}

// Hit of a ray from a position with the surfaces in the image: texture coordinate and 1, or 0 for
// none. Steps are uniform in the image, where the inverse of depth is linear, and end at `inStep` in
// (0, 1] of each.
vec3 traceScreenSpace(vec3 position, vec3 ray, vec3 normal, float inStep) {
  const int STEPS = 20, HALVINGS = 4;
  const float MAX_LENGTH = 120.0, NEAR = 0.2;
  vec3 start = (cameraBuffer.viewMatrix * vec4(position, 1.0)).xyz;
  vec3 along = mat3(cameraBuffer.viewMatrix) * ray;
  float range = along.z > 0.0 ? min(MAX_LENGTH, (-NEAR - start.z) / along.z) : MAX_LENGTH;
  vec4 clip0 = cameraBuffer.projectionMatrix * vec4(start, 1.0);
  vec4 clip1 = cameraBuffer.projectionMatrix * vec4(start + along * range, 1.0);
  vec3 from = vec3(clip0.xy / clip0.w, 1.0 / clip0.w);
  vec3 offset = vec3(clip1.xy / clip1.w, 1.0 / clip1.w) - from;
  vec2 exits = (sign(offset.xy) - from.xy) / (offset.xy + vec2(equal(offset.xy, vec2(0.0))));
  float leavesX = offset.x == 0.0 ? 1.0 : exits.x, leavesY = offset.y == 0.0 ? 1.0 : exits.y;
  offset *= clamp(min(leavesX, leavesY), 0.0, 1.0);
  float before = 0.0, depthBefore = clip0.w;
  for (int i = 0; i < STEPS; ++i) {
    float fraction = (float(i) + inStep) / float(STEPS);
    vec3 point = from + offset * fraction;
    float depth = 1.0 / point.z;
    float seen = depthAt(point.xy);
    float behind = depth - seen;
    if (seen > 0.0 && behind > 0.0 && behind < 1.0 + 1.5 * abs(depth - depthBefore)
        && isInFrontOfMirror(point.xy, seen, position, normal)) {
      float after = fraction;
      for (int k = 0; k < HALVINGS; ++k) {
        float middle = 0.5 * (before + after);
        point = from + offset * middle;
        seen = depthAt(point.xy);
        if (seen > 0.0 && 1.0 / point.z > seen) after = middle;
        else before = middle;
      }
      return vec3((from + offset * after).xy * 0.5 + 0.5, 1.0);
    }
    before = fraction;
    depthBefore = depth;
  }
  return vec3(0.0);
}

// Radiance that a level mirror reflects: from the image if the ray hits something in it, else from
// what surrounds it. A rough one smears it vertically, as wet asphalt does. `jitter` in [0, 1) moves the samples.
vec3 mirrorRadiance(vec3 position, vec3 ray, vec3 normal, float alpha, float distance, float jitter) {
  const int TAPS = 5;
  vec3 mirror = reflect(ray, normal);
  if (mirror.z <= 0.0) return airlight(mirror).rgb;
  ProbeLight probe = probeLight(position, normal);
  vec3 middle = lobeMiddle(ray, normal, alpha), surroundings = surroundingRadiance(probe, middle);
  vec3 found = traceScreenSpace(position, mirror, normal, 1.0 - jitter);
  if (found.z == 0.0) return widenLobe(probe, middle, alpha, surroundings);
  float distancePerDepth;
  rayThrough(found.xy, distancePerDepth);
  float beyond = max(depthAt(found.xy * 2.0 - 1.0) * distancePerDepth, distance) - distance;
  float smear = alpha * 0.5 * cameraBuffer.projectionMatrix[1][1] * beyond / (distance + beyond);
  vec3 sum = vec3(0.0);
  for (int i = 0; i < TAPS; ++i) {
    float offset = (float(i) + jitter) / float(TAPS) * 2.0 - 1.0;
    vec2 place = pixelPlace(found.xy + vec2(0.0, offset * smear));
    place = clamp(place, vec2(0.5), vec2(pixelCount()) - 0.5);
    sum += textureLod(samplerLit, place / vec2(sampleCount()), 0.0).rgb;
  }
  // Fades to the surroundings towards the edges of the image.
  vec2 edge = smoothstep(vec2(0.0), vec2(0.05), 0.5 - abs(found.xy - 0.5));
  vec3 seen = applyAir(sum / float(TAPS), mirror, beyond);
  return widenLobe(probe, middle, alpha, mix(surroundings, seen, edge.x * edge.y));
}

// Correction of the sky's light in `samplerLit`: the ambient occlusion of the dithered pixels of the
// same surface, averaged, in place of the pixel's own.
vec3 filterAmbient(float depth) {
  const float TOLERANCE = 0.03;
  vec4 own = texelFetch(samplerAmbient, wholeNumber(floor(gl_FragCoord.xy)), 0);
  ivec2 first = ditherBlock(pixelOf(wholeNumber(floor(gl_FragCoord.xy))), pixelCount());
  float sum = 0.0, weight = 0.0;
  for (int i = 0; i < DITHER * DITHER; ++i) {
    ivec2 texel = first + ivec2(i % DITHER, i / DITHER);
    float difference = abs(texelFetch(samplerLit, texel, 0).a - depth);
    float similarity = max(1.0 - difference / (TOLERANCE * depth), 0.0);
    sum += similarity * texelFetch(samplerAmbient, texel, 0).a;
    weight += similarity;
  }
  return weight > 0.0 ? own.rgb * (sum / weight - own.a) : vec3(0.0);
}

// Light of lamps that a surface at a pixel or another sample reflects.
vec3 lightByLamps(vec4 lit, ivec2 pixel) {
  vec4 ambient = texelFetch(samplerAmbient, pixel, 0);
  return max(lit.rgb - ambient.rgb * ambient.a, 0.0);
}

// Light that fog deflects of a texel of the first level.
vec4 deflectedTexel(ivec2 texel) {
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 4; ++i) {
    ivec2 pixel = min(2 * texel + ivec2(i & 1, i >> 1), pixelCount() - 1);
    vec4 lit = texelFetch(samplerLit, pixel, 0);
    if (lit.a <= 0.0) continue;
    float distancePerDepth;
    rayThrough(imagePlace(surfaceTexel(pixel)), distancePerDepth);
    float distance = lit.a * distancePerDepth, depth = narrowDepth(distance);
    vec3 light = lightByLamps(lit, pixel) * (1.0 - exp(-depth)) * unscatteredTransmittance(distance);
    sum += 0.25 * vec4(light, depth * (light.r + light.g + light.b));
  }
  return sum;
}

// Radiance through a pane at a position, with what it mirrors of its surroundings and the sun.
vec3 paneRadiance(vec3 behind, vec3 position, vec3 normal, vec3 ray) {
  float reflectance = paneReflectance(dot(ray, normal));
  Surface pane = paneSurface(normal);
  return behind * (GLASS_TRANSMITTANCE * (1.0 - reflectance))
      + reflectance * mirroredLobe(probeLight(position, normal), lobeMiddle(ray, normal, pane.alpha), pane.alpha)
      + specularLobe(pane, -ray, sunDirection()) * sunIrradiance();
}

// Distance along a ray to a depth in images of light, and to the end of the world where there is none.
float distanceTo(float depth, float distancePerDepth) {
  return depth > 0.0 ? depth * distancePerDepth : FAR_M;
}

// Light of lamps that air scatters into the ray of a pixel, and the depth of its surface.
vec4 lampGlow(ivec2 pixel, vec3 eye, float jitter) {
  vec2 place = imagePlace(surfaceTexel(pixel));
  float distancePerDepth, depth = texelFetch(samplerLit, pixel, 0).a;
  vec3 ray = rayThrough(place, distancePerDepth);
  float distance = distanceTo(depth, distancePerDepth);
  vec3 glow = lampsInScattering(place, eye, ray, distance, GlowSteps(5, 2, 2), jitter);
  return vec4(glow, depth > 0.0 ? depth : FAR_M);
}

// Texel of the image of glow, and of light that fog deflects to the right of it.
vec4 glowTexel(ivec2 texel, vec3 eye) {
  if (all(lessThan(texel, glowCount()))) {
    vec4 glow = lampGlow(glowPixel(texel), eye, coarseDither(texel));
    return deflectsVisibly() ? vec4(glow.rgb, -glow.a) : glow;
  }
  ivec2 at = texel - deflectedOrigin();
  bool isOne = at.x >= 0 && all(lessThan(at, levelSize(1)));
  return isOne && deflectsVisibly() ? deflectedTexel(at) : vec4(0.0);
}

void main() {
  ivec2 pixel = wholeNumber(floor(gl_FragCoord.xy)), texel = surfaceTexel(pixel);
  vec3 eye = cameraBuffer.viewMatrixInverse[3].xyz;
  float jitter = dither(gl_FragCoord.xy);
  outReflex = vec4(0.0);
  outGlow = vec4(0.0);
  if (isNight()) {
    fetchLampAir();
    outGlow = glowTexel(pixel, eye);
  }
  vec4 lit = texelFetch(samplerLit, pixel, 0);
  if (lit.a == NO_LIGHT) {
    outSeen = lit;
    return;
  }
  vec2 place = imagePlace(texel);
  float distancePerDepth;
  vec3 ray = rayThrough(place, distancePerDepth);
  float depth = lit.a;
  float distance = distanceTo(depth, distancePerDepth);
  vec4 pane = texelFetch(samplerPane, texel, 0);
  float height = sqrt(max(1.0 - dot(pane.xy, pane.xy), 0.0));
  vec3 paneNormal = vec3(pane.xy, pane.z < 0.0 ? -height : height);
  vec3 panePosition = eye + ray * abs(pane.z) * distancePerDepth;
  if (depth <= 0.0) {
    outSeen = pane.z == 0.0 ? vec4(lit.rgb, 0.0)
        : vec4(paneRadiance(lit.rgb, panePosition, paneNormal, ray), abs(pane.z));
    return;
  }
  vec3 radiance = lit.rgb;
  if (isNight() && deflectsVisibly()) {
    // What is deflected by less than its pixel stays there.
    float kept = fractionNarrower(narrowestOf(1), spreadInPixels(place, narrowDepth(distance)));
    radiance += kept * (undeflectedGain(distance) - 1.0) * lightByLamps(lit, pixel);
  }
  if (!isDark()) radiance += filterAmbient(depth);
  vec4 mirror = texelFetch(samplerMirror, pixel, 0);
  if (mirror.z > 0.0) {
    vec3 normal = vec3(mirror.xy, sqrt(max(1.0 - dot(mirror.xy, mirror.xy), 0.0)));
    vec3 mirrored = mirror.z
        * mirrorRadiance(eye + ray * distance, ray, normal, mirror.w, distance, jitter);
    if (pane.z != 0.0) radiance += mirrored;
    else outReflex = vec4(mirrored * transmittance(distance), 1.0);
  }
  if (isNight()) {
    float emission = texelFetch(samplerDepthEmission, texel, 0).y;
    if (emission > 0.0) radiance += emission * texelFetch(samplerColour, texel, 0).rgb;
  }
  if (pane.z != 0.0) radiance = paneRadiance(radiance, panePosition, paneNormal, ray);
  outSeen = vec4(applyAir(radiance, ray, distance), pane.z != 0.0 ? abs(pane.z) : depth);
}
