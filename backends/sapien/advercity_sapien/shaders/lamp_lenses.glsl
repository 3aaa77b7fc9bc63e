// Emission of lamps' lenses; needs shader_constants.glsl.

// Radiance in kcd/m² per albedo.
//   kind: the material's LENS_..., 0 for other materials
//   lit: the lit lamps of the body, LIT_... together
float lensEmission(int kind, int lit) {
  if (kind == LENS_LAMP_WHITE) return (lit & LIT_LOW_BEAM) != 0 ? 25.0 : 0.0;
  if (kind == LENS_LAMP_RED) {
    // Brake and fog lamps are bright; tail lamps are on with the low beam.
    return (lit & (LIT_BRAKE | LIT_FOG)) != 0 ? 20.0 : (lit & LIT_LOW_BEAM) != 0 ? 1.2 : 0.0;
  }
  // 400 cd over the 0.053 m² of a signal's lens, by the luminance of its colour.
  if (kind == LENS_SIGNAL_RED) return (lit & LIT_SIGNAL_RED) != 0 ? 139.0 : 0.0;
  if (kind == LENS_SIGNAL_YELLOW) return (lit & LIT_SIGNAL_YELLOW) != 0 ? 56.0 : 0.0;
  if (kind == LENS_SIGNAL_GREEN) return (lit & LIT_SIGNAL_GREEN) != 0 ? 69.0 : 0.0;
  if (kind == LENS_LAMP_AMBER_LEFT) return (lit & LIT_LEFT) != 0 ? 40.0 : 0.0;
  if (kind == LENS_LAMP_AMBER_RIGHT) return (lit & LIT_RIGHT) != 0 ? 40.0 : 0.0;
  return 0.0;
}
