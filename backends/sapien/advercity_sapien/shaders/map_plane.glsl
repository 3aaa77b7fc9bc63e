// The plane that the images of a surface lie in: coordinates on it, metres to the right and up, and
// where that is in space. Needs shader_constants.glsl and sampling.glsl.

struct MapPlane {
  vec2 at;
  mat2x3 axes;
  vec2 scale;  // metres per unit of the coordinates
};

// Whether copies of an image may overlap: grains and blades may, courses of bricks and images of models,
// whose materials have no pattern, may not.
bool isUnordered(int kind) {
  return kind != TEXTURE_BRICK && kind != TEXTURE_TILES && kind != TEXTURE_SLABS
      && kind != TEXTURE_WOOD && kind != TEXTURE_PLAIN;
}

// Whether a surface is a pane before a room (rooms.glsl).
bool isRoom(int kind) { return kind == TEXTURE_ROOM || kind == TEXTURE_SHOP; }

MapPlane planeAlong(vec3 right, vec3 n, vec2 at) {
  right = normalize(right - n * dot(right, n));
  return MapPlane(at, mat2x3(right, cross(n, right)), vec2(1.0));
}

// Plane along the world's axes at a point p of a surface of normal n. Courses run level on walls and
// roofs of any direction; grains lie along the nearest axis, as normals of smooth surfaces turn.
MapPlane worldPlane(int kind, vec3 p, vec3 n) {
  const float STEEP = 0.7;
  float slope = length(n.xy);
  bool unordered = isUnordered(kind);
  if (slope < (unordered ? STEEP : LEVEL)) return planeAlong(vec3(1.0, 0.0, 0.0), n, p.xy);
  if (!unordered) return planeAlong(vec3(-n.y, n.x, 0.0), n, surfaceUv(p, n));
  vec3 right = abs(n.x) > abs(n.y) ? vec3(0.0, sign(n.x), 0.0) : vec3(-sign(n.y), 0.0, 0.0);
  return planeAlong(right, n, vec2(dot(p, right), p.z));
}

// Plane of the mesh's own coordinates, of which two steps on the surface are known. Triangles that
// are a point of the image have no axes of their own, and a scale of 0.
MapPlane meshPlane(vec2 uv, vec3 n, vec3 step1, vec3 step2, vec2 uvStep1, vec2 uvStep2) {
  vec3 right = step1 * uvStep2.y - step2 * uvStep1.y;
  float turned = uvStep1.x * uvStep2.y - uvStep2.x * uvStep1.y;
  if (dot(right, right) < 1e-20) right = abs(n.z) < 0.9 ? vec3(-n.y, n.x, 0.0) : vec3(1.0, 0.0, 0.0);
  MapPlane plane = planeAlong(turned < 0.0 ? -right : right, n, uv);
  vec3 up = step2 * uvStep1.x - step1 * uvStep2.x;
  plane.scale = turned == 0.0 ? vec2(0.0) : vec2(length(right), length(up)) / abs(turned);
  return plane;
}
