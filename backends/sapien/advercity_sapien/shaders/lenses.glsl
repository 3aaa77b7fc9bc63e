// Which lenses shine: `kind` is the material's, `lit` the actor's lamps (bits of Lamp).

// Radiance in kcd/m² per albedo.
float lensEmission(float kind, int lit) {
  if (kind == 1.0) return (lit & 1) != 0 ? 25.0 : 0.0;
  if (kind == 2.0) return (lit & 6) != 0 ? 20.0 : (lit & 1) != 0 ? 1.2 : 0.0;
  // A signal's lenses: their own bit, and 400 cd over 0.053 m² whatever the colour.
  if (kind == 3.0) return (lit & 32) != 0 ? 139.0 : 0.0;
  if (kind == 4.0) return (lit & 64) != 0 ? 56.0 : 0.0;
  if (kind == 5.0) return (lit & 128) != 0 ? 69.0 : 0.0;
  if (kind == 6.0) return (lit & 8) != 0 ? 40.0 : 0.0;
  if (kind == 7.0) return (lit & 16) != 0 ? 40.0 : 0.0;
  return 0.0;
}
