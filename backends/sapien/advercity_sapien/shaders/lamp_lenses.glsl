// Emission of lamps' lenses; needs shader_constants.glsl.

// Light of the flickering lamps of a body relative to its mean.
float lightRatio(int lit) {
  int stored = lit >> LIGHT_RATIO_BIT;
  return stored == 0 ? 1.0 : float(stored - 1) / float(LIGHT_RATIO_STEPS);
}

// Radiance in kcd/m² per albedo.
//   kind: the material's LENS_..., 0 for other materials
//   lit: the lit lamps of the body, LIT_... together
float lensEmission(int kind, int lit) {
  if (kind == LENS_LAMP_WHITE) return (lit & LIT_LOW_BEAM) != 0 ? LAMP_WHITE_LUMINANCE : 0.0;
  if (kind == LENS_LAMP_RED) {
    // Brake and fog lamps are bright; tail lamps are on with the low beam.
    if ((lit & (LIT_BRAKE | LIT_FOG)) != 0) return LAMP_RED_LUMINANCE;
    return (lit & LIT_LOW_BEAM) != 0 ? lightRatio(lit) * TAIL_LAMP_LUMINANCE : 0.0;
  }
  if (kind == LENS_SIGNAL_RED) {
    return (lit & LIT_SIGNAL_RED) != 0 ? lightRatio(lit) * SIGNAL_RED_LUMINANCE : 0.0;
  }
  if (kind == LENS_SIGNAL_YELLOW) {
    return (lit & LIT_SIGNAL_YELLOW) != 0 ? lightRatio(lit) * SIGNAL_YELLOW_LUMINANCE : 0.0;
  }
  if (kind == LENS_SIGNAL_GREEN) {
    return (lit & LIT_SIGNAL_GREEN) != 0 ? lightRatio(lit) * SIGNAL_GREEN_LUMINANCE : 0.0;
  }
  if (kind == LENS_LAMP_AMBER_LEFT) return (lit & LIT_LEFT) != 0 ? LAMP_AMBER_LEFT_LUMINANCE : 0.0;
  if (kind == LENS_LAMP_AMBER_RIGHT) return (lit & LIT_RIGHT) != 0 ? LAMP_AMBER_RIGHT_LUMINANCE : 0.0;
  if ((lit & LIT_LOW_BEAM) == 0) return 0.0;
  if (kind == LENS_ROOM_WARM) return ROOM_WARM_LUMINANCE;
  if (kind == LENS_ROOM_COOL) return ROOM_COOL_LUMINANCE;
  return kind == LENS_ROOM_SHOP ? ROOM_SHOP_LUMINANCE : 0.0;
}
