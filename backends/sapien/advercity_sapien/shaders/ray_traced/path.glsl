// Payload of a ray: a path from a camera, which every hit follows by one step.

struct Path {
  vec3 origin;
  vec3 ray;         // unit
  vec3 radiance;    // kcd/m², found so far
  vec3 throughput;
  float travelled;  // m
  int depth;        // surfaces that it has left
  int panes;        // that it has met since
  bool mirrored;    // at the last surface
  bool seesLenses;
  bool hasEnded;
  uint randomState;

  // Of its pixel.
  vec2 uv;
  float pixelAngle;

  // What the camera sees: the first hit. Of a pane, albedo is that of what is behind it.
  vec3 firstNormal;
  float firstDistance;  // negative: the sky
  vec3 firstAlbedo;
  uint firstIdentity;

  // Another ray from the camera, off the first by an angle, is wanted for light that fog deflects.
  bool isDeflected;
  vec3 deflectedRay;
  float deflection;      // rad
  float spread;          // of the angles that were drawn from
  float clearDistance;   // to what the first ray hits
};
