// Attenuation and airlight along a ray; needs atmosphere.glsl, samplerAirlight.

// Source function of the air: radiance that it adds per unit opacity, kcd/m². The last component is
// the relative growth over an infinite ray, for rays that rise into brighter fog.
vec4 airlight(vec3 ray) {
  float texels = float(textureSize(samplerAirlight, 0).x);
  return textureLod(samplerAirlight, cubemapUv(ray, texels), 0.0);
}

// Attenuate the radiance of a surface at a distance and add the airlight before it.
vec3 applyAir(vec3 radiance, vec3 ray, float distance) {
  float depth = extinction() * distance, left = exp(-depth);
  vec4 air = airlight(ray);
  return radiance * left + air.rgb * (1.0 - left + air.a * (1.0 - left * (1.0 + depth)));
}
