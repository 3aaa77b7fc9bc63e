// What mirrors show beyond the image: the sky above the skylines that skylines.py has baked, and the ground.
// Needs light_probes.glsl, airlight.glsl, surface.glsl, samplerSkylineLight and samplerSkylineNearness.

// Radiance in a direction, of a perfect mirror near a probe.
vec3 surroundingRadiance(ProbeLight probe, vec3 ray) {
  const float SOFT = 0.05, LEAST = 1e-3;  // tangent
  vec3 open = sky(ray);
  if (probe.fraction <= 0.0) return open;
  float level = max(length(ray.xy), LEAST), slope = ray.z / level;
  float turn = fract(atan(ray.y, ray.x) / (2.0 * PI)) * float(SKYLINE_AZIMUTHS);
  int first = min(int(turn), SKYLINE_AZIMUTHS - 1), second = (first + 1) % SKYLINE_AZIMUTHS;
  vec4 light = mix(probeTexel(samplerSkylineLight, probe.at, first, SKYLINE_AZIMUTHS),
      probeTexel(samplerSkylineLight, probe.at, second, SKYLINE_AZIMUTHS), turn - float(first));
  float nearness = mix(probeTexel(samplerSkylineNearness, probe.at, first, SKYLINE_AZIMUTHS).r,
      probeTexel(samplerSkylineNearness, probe.at, second, SKYLINE_AZIMUTHS).r,
      turn - float(first)) / SKYLINE_NEAREST;
  float top = light.a - (probe.height - SKYLINE_HEIGHT) * nearness;
  float hidden = probe.fraction * smoothstep(-SOFT, SOFT, top - SOFT - slope);
  float distance = min(1.0 / (max(nearness, LEAST) * level), FAR_M);
  vec3 above = mix(open, applyAir(light.rgb, ray, distance), hidden);
  float foot = -probe.height * nearness;
  if (slope > foot + SOFT) return above;
  return mix(open * irradianceRatio(probe, ray), above, smoothstep(-SOFT, SOFT, slope - foot));
}

// Mean direction of what a lobe of width `alpha` mirrors. At grazing angles rough surfaces show most of the facets that
// face the eye, and so what is higher up than a smooth one does. The slope that does the same is fitted to GGX with
// Fresnel's reflectance, of water and varnish (within 0.03 for an `alpha` up to 0.25).
vec3 lobeMiddle(vec3 ray, vec3 n, float alpha) {
  float cosine = max(-dot(ray, n), 0.0);
  float slope = 1.3 * alpha / (1.0 + 2.6 * alpha) * exp(-cosine / (1.4 * alpha));
  vec3 towardsEye = -ray - n * cosine;
  return reflect(ray, normalize(n + slope / max(length(towardsEye), 1e-4) * towardsEye));
}

// Radiance in a mirror whose lobe has the width `alpha`, by its middle: between that of a perfect one, which is given,
// and the mean.
vec3 widenLobe(ProbeLight probe, vec3 middle, float alpha, vec3 perfect) {
  vec3 mean = skyIrradiance(middle) / PI * irradianceRatio(probe, middle);
  return mix(mean, perfect, exp(-3.0 * alpha));
}

vec3 mirroredLobe(ProbeLight probe, vec3 middle, float alpha) {
  return widenLobe(probe, middle, alpha, surroundingRadiance(probe, middle));
}
