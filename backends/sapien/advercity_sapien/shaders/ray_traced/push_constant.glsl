layout(push_constant) uniform Constants {
  int samples;
  int pathDepth;
  int seed;
  int hiding;
};
