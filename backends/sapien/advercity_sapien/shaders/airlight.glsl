// What air adds to a ray and takes from it; needs atmosphere.glsl, samplerAirlight.

// Of the light that air takes away, it sends as much to the eye; more along rays that climb, in
// fog that is brighter higher up: evenly so, by the last component over an endless ray.
vec4 airlight(vec3 ray) {
  float texels = float(textureSize(samplerAirlight, 0).x);
  return textureLod(samplerAirlight, onFaces(ray, texels), 0.0);
}

vec3 throughAir(vec3 radiance, vec3 ray, float distance) {
  float depth = extinction() * distance, left = exp(-depth);
  vec4 air = airlight(ray);
  return radiance * left + air.rgb * (1.0 - left + air.a * (1.0 - left * (1.0 + depth)));
}
