// Properties of the camera that the renderer sets; SAPIEN finds them by name.
layout(push_constant) uniform Constants {
  int samples;
  int pathDepth;
  int seed;
  int hiding;
};
