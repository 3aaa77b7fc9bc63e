#version 460
#extension GL_EXT_ray_tracing : require
#extension GL_EXT_scalar_block_layout : enable
#extension GL_EXT_nonuniform_qualifier : enable

#include "../whole_numbers.glsl"
#include "../shader_constants.glsl"
#include "../sampling.glsl"
#include "../map_plane.glsl"
#include "./path.glsl"
#include "./scene.glsl"
#include "./scene_textures.glsl"
#include "./push_constant.glsl"
#include "../shader_table.glsl"
#include "./body_state.glsl"
#include "../lamp_lenses.glsl"
#include "./ray_hit.glsl"
#include "../atmosphere.glsl"
#include "../airlight.glsl"
#include "../surface.glsl"
#include "../texture.glsl"
#include "../ground.glsl"
#include "../deflection.glsl"
#include "../lamps.glsl"
#include "./random.glsl"

int toneIndex, reliefIndex;
#define mapTone textures[nonuniformEXT(toneIndex)]
#define mapRelief textures[nonuniformEXT(reliefIndex)]
#include "../material_maps.glsl"
#include "../rooms.glsl"

layout(location = 0) rayPayloadInEXT Path path;
layout(location = 1) rayPayloadEXT bool blocked;

// Apply the images of a hit's material to its albedo and roughness; returns the normal with relief.
vec3 applyMaps(inout RayHit hit, vec3 ray, float pixelWidth) {
  Material material = materials[nonuniformEXT(hit.material)].m;
  toneIndex = textureIndices.t[hit.material].diffuse;
  reliefIndex = textureIndices.t[hit.material].normal;
  vec4 range = vec4(material.fresnel, material.ior, material.transmissionRoughness, MAX_ROUGHNESS_RATIO);
  MapSample maps = sampleMaps(hit.texture, abs(material.emission.w), range,
      (material.textureMask & HAS_RELIEF) != 0, hit.plane, hit.normal, ray, pixelWidth);
  hit.albedo = min(hit.albedo * maps.tone.rgb, 1.0);
  hit.roughness = min(hit.roughness * maps.tone.a, 1.0);
  return reliefNormal(hit.normal, hit.plane, maps.slope);
}

bool isVisible(vec3 origin, vec3 ray, float distance) {
  blocked = true;
  traceRayEXT(tlas,
      gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsOpaqueEXT | gl_RayFlagsSkipClosestHitShaderEXT,
      0xff, 0, 0, 1, origin, 0.0, ray, distance, 1);
  return !blocked;
}

// Rays from every step of a ray through the air would take longer than all others: of glow, only what is
// behind the vehicle ahead is hidden.
float airVisibility(Lamp l, vec3 away) {
  float freePath = lampTexel(l.number, 3).x;  // before another vehicle
  return step(dot(away, l.facing), freePath);
}

// Radiance of a surface in direct sunlight; one shadow ray.
vec3 sunRadiance(Surface s, vec3 towardsEye, vec3 position) {
  vec3 light = brdfCosine(s, towardsEye, sunDirection()) * sunIrradiance();
  if (light.g <= 0.0 || !isVisible(position, sunDirection(), FAR_M)) return vec3(0.0);
  return light;
}

// Weighted reservoir: one of many lamps, drawn in proportion to its light, represents all of them.
struct Reservoir {
  vec3 light;
  vec3 lampPosition;
  float weight;
  float total;
};

void updateReservoir(inout Reservoir c, Lamp l, vec3 light) {
  float gives = light.r + light.g + light.b;
  if (gives <= 0.0) return;
  c.total += gives;
  if (random() * c.total < gives) {
    c.light = light;
    c.weight = gives;
    c.lampPosition = l.position;
  }
}

// Radiance of a surface by the lamps of its cell, and those that it mirrors; one shadow ray.
vec3 lampRadiance(Surface s, vec3 towardsEye, vec3 position) {
  const float HOUSING = 0.25;  // metres around a lamp that do not hide it
  Reservoir c = Reservoir(vec3(0.0), vec3(0.0), 1.0, 0.0);
  bool mirrors = isMirrorLike(s);
  float coatLeaves = coatTransmittance(s, dot(s.normal, towardsEye));
  ivec2 cell = cellList(position.xy);
  for (int i = cell.x; i < cell.y; ++i) {
    ivec4 four = lampQuad(CELL_LAMPS_ROW, i);
    for (int j = 0; j < 4 && four[j] >= 0; ++j) {
      Lamp l = fetchLamp(four[j]);
      // Paths find what the road reflects.
      updateReservoir(c, l, lampReflection(l, s, towardsEye, coatLeaves, position, mirrors, false));
    }
  }
  if (mirrors) {
    int list = bearingList(-towardsEye.xy);
    for (int i = 0; i < TEXELS_PER_BEARING; ++i) {
      ivec4 four = lampQuad(BEARINGS_ROW, list + i);
      for (int j = 0; j < 4 && four[j] >= 0; ++j) {
        Lamp l = fetchLamp(four[j]);
        updateReservoir(c, l, lampMirrorReflection(l, s, towardsEye, position));
      }
    }
  }
  if (c.total <= 0.0) return vec3(0.0);
  vec3 toLamp = c.lampPosition - position;
  float distance = length(toLamp);
  if (distance > HOUSING && !isVisible(position, toLamp / distance, distance - HOUSING)) {
    return vec3(0.0);
  }
  return c.light * (c.total / c.weight);
}

// Draw the next direction of a path at a surface; returns the weight.
vec3 sampleBounce(Surface s, inout vec3 ray, out bool mirrored) {
  vec3 towardsEye = -ray;
  float nv = max(dot(s.normal, towardsEye), 1e-3);
  vec3 coat = fresnelReflectance(s, nv);
  float fraction = coat.g > 1e-4 ? clamp(coat.g / max(coat.g + s.albedo.g, 1e-4), 0.1, 1.0) : 0.0;
  mat3 frame = tangentFrame(s.normal);
  mirrored = random() < fraction;
  if (!mirrored) {
    ray = frame * cosineDirection();
    float both = 1.0 + s.through;
    if (s.through > 0.0 && random() * both < s.through) ray = -ray;
    return s.albedo * both * coatTransmittance(s, nv) * coatTransmittance(s, dot(ray, s.normal))
        / (1.0 - fraction);
  }
  vec3 h = frame * visibleNormal(towardsEye * frame, s.alpha);
  ray = reflect(-towardsEye, h);
  float nl = dot(s.normal, ray);
  if (nl <= 0.0) return vec3(0.0);
  float a2 = s.alpha * s.alpha;
  float eye = sqrt(nv * nv * (1.0 - a2) + a2), light = sqrt(nl * nl * (1.0 - a2) + a2);
  return fresnelReflectance(s, dot(towardsEye, h)) / fraction * nl * (nv + eye)
      / (nl * eye + nv * light);
}

// Draw the angle of a deflection by a random number in [0, 1), up to MOST_DEFLECTED of all.
float drawDeflection(float number, float spread) {
  float rest = 1.0 - MOST_DEFLECTED * number;
  return spread * (1.0 - rest * rest) / (2.0 * rest);
}

// Direction at an angle off a ray, turned around it.
vec3 deflectRay(vec3 ray, float angle, float turn) {
  vec3 across = normalize(cross(ray, abs(ray.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0)));
  return cos(angle) * ray + sin(angle) * (cos(turn) * across + sin(turn) * cross(ray, across));
}

// Weight of the lamp-lit radiance of a surface that is seen at an angle off a ray, for one drawn
// with a spread: part of it that fog deflects into the ray, and that it leaves.
float deflectedWeight(float angle, float spread, float distance) {
  float depth = narrowDepth(distance);
  float given = deflectionDensity(angle, forwardSpread(depth)) / deflectionDensity(angle, spread);
  return MOST_DEFLECTED * given * (1.0 - exp(-depth)) * unscatteredTransmittance(distance);
}

// Add the radiance of a surface around the first ray that lamps light and fog deflects into it. What is
// deflected beyond the surface that is seen does not get through it.
void addDeflectedLight() {
  path.isDeflected = false;
  if (isSky()) return;
  RayHit hit = findHit();
  vec3 ray = gl_WorldRayDirectionEXT, position = gl_WorldRayOriginEXT + ray * hit.distance;
  Surface s = buildSurface(hit.albedo, hit.roughness, hit.metallic, hit.texture, hit.snowless, position,
      hit.normal, hit.normal, 0.5);
  position += hit.normal * (1e-3 + 1e-5 * hit.distance);
  float before = min(path.clearDistance / hit.distance, 1.0);
  path.radiance += before * deflectedWeight(path.deflection, path.spread, hit.distance)
      * lampRadiance(s, -ray, position);
}

// Ask for one more ray, for light that fog deflects.
void drawDeflectedRay(vec3 ray, float distance) {
  path.isDeflected = true;
  path.clearDistance = distance;
  path.spread = forwardSpread(narrowDepth(min(distance, 60.0)));
  path.deflection = drawDeflection(random(), path.spread);
  path.deflectedRay = deflectRay(ray, path.deflection, 2.0 * PI * random());
}

// Lobes narrower than this show lamps where paths hit their lenses; wider ones sample the lamps. No
// light is counted twice.
const float MIRROR = 0.1;
const int MAX_PANES = 6;

// Pass a pane, or be reflected by it.
void passPane(RayHit hit, vec3 ray, vec3 position) {
  float away = 1e-3 + 1e-5 * hit.distance;
  path.radiance += path.throughput * sunRadiance(paneSurface(hit.normal), -ray, position + away * hit.normal);
  bool isReflected = random() < paneReflectance(dot(ray, hit.normal));
  if (isReflected) path.ray = reflect(ray, hit.normal);
  else path.throughput *= GLASS_TRANSMITTANCE;
  path.origin = position + away * (isReflected ? hit.normal : ray);
  ++path.panes;
}

// Add the light that a surface gives, and draw how the path goes on.
void leaveSurface(RayHit hit, vec3 ray, vec3 position) {
  float pixelWidth = footprint(path.pixelAngle, hit.distance, abs(dot(ray, hit.normal)));
  vec3 relief = hit.normal;
  // After the first hit texture is averaged: it would only add noise.
  if (path.depth == 0) {
    bool isMapped = (materials[nonuniformEXT(hit.material)].m.textureMask & HAS_TONE) != 0;
    float width = path.pixelAngle * hit.distance;
    if (isMapped) relief = applyMaps(hit, ray, width);
    if (isRoom(hit.texture)) {
      hit.albedo = roomAlbedo(hit.texture, hit.albedo, hit.emission > 0.0, hit.plane, hit.normal, ray, width);
    }
    hit.albedo *= materialDetail(hit.texture, isMapped, position, hit.normal, pixelWidth);
  } else {
    pixelWidth = max(pixelWidth, 0.5);
  }
  if (path.seesLenses) path.radiance += path.throughput * hit.emission * hit.albedo;

  Surface s = buildSurface(hit.albedo, hit.roughness, hit.metallic, hit.texture, hit.snowless, position,
      hit.normal, relief, pixelWidth);
  if (path.depth == 0) path.firstAlbedo = s.albedo + fresnelReflectance(s, abs(dot(ray, s.normal)));
  // After a diffuse bounce mirrors would only add bright single pixels.
  if (!path.mirrored) s.alpha = max(s.alpha, 0.5);
  float offset = 1e-3 + 1e-5 * hit.distance;
  // The normal of a crown may point behind the leaf: towards the sun is before what hides it.
  path.origin = position + offset * (s.through > 0.0 ? sunDirection() : hit.normal);
  Surface matt = s;
  if (isNight() && s.alpha < MIRROR) matt.coat = 0.0, matt.metal = vec3(0.0);
  path.radiance += path.throughput * sunRadiance(s, -ray, path.origin);
  path.travelled += hit.distance;
  if (isNight()) {
    // What one surface sees of another is wide, and loses nothing to small deflections.
    bool isDeflected = path.depth == 0 && deflectsVisibly();
    float kept = isDeflected ? 1.0 : undeflectedGain(path.travelled);
    path.radiance += path.throughput * kept * lampRadiance(matt, -ray, path.origin);
    if (isDeflected) drawDeflectedRay(ray, hit.distance);
  }
  if (path.depth == pathDepth) {
    path.hasEnded = true;
    return;
  }
  path.throughput *= sampleBounce(s, path.ray, path.mirrored);
  if (s.through > 0.0) path.origin = position + offset * path.ray;
  path.seesLenses = path.mirrored && (!isNight() || s.alpha < MIRROR);
  path.hasEnded = dot(path.throughput, vec3(1.0)) <= 1e-5;
  ++path.depth;
  path.panes = 0;
}

void seeFirst(RayHit hit) {
  path.firstDistance = hit.distance;
  path.firstNormal = hit.normal;
  path.firstIdentity = hit.identity;
}

// Follow the path by one step: to the sky, through a pane, or off a surface.
void followPath() {
  vec3 eye = gl_WorldRayOriginEXT, ray = gl_WorldRayDirectionEXT;
  if (path.depth == 0 && path.panes == 0) {
    if (!isSky()) seeFirst(findHit());
    path.radiance += lampsInScattering(path.uv, eye, ray, min(gl_HitTEXT, FAR_M), GlowSteps(3, 1, 1), random());
  }
  if (isSky()) {
    path.radiance += path.throughput * sky(ray);
    path.hasEnded = true;
    return;
  }
  RayHit hit = findHit();
  path.radiance += path.throughput * applyAir(vec3(0.0), ray, hit.distance);
  path.throughput *= transmittance(hit.distance);
  vec3 position = eye + ray * hit.distance;
  if (hit.pane && path.panes < MAX_PANES) passPane(hit, ray, position);
  else leaveSurface(hit, ray, position);
}

void main() {
  bindSceneTextures();
  if (isNight()) fetchLampAir();
  randomState = path.randomState;
  if (path.isDeflected) addDeflectedLight();
  else followPath();
  path.randomState = randomState;
}
