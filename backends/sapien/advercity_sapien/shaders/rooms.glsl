// Rooms behind the panes of buildings: interior mapping (van Dongen 2008). A ray is followed to the walls of
// a box, and to furniture in it. Panes tell by whole numbers of their coordinates which room is behind
// them and what covers it; each spans the middle half of a unit of either. Needs shader_constants.glsl,
// whole_numbers.glsl, sampling.glsl and map_plane.glsl; Mitsuba has the same in rooms.py.

struct Room {
  int number;
  bool isShop;
  bool isLit;    // by its lamp, else by daylight
  vec2 window;   // metres; the origin of the room is its lower left corner
  vec3 low;
  vec3 high;
};

struct RoomHit {
  float distance;
  vec3 normal;
  int piece;     // of furniture, -1 for the room itself
};

float drawOf(int number, int salt) { return 0.5 + 0.5 * hashUnit(ivec3(number, 7, salt)); }

vec3 drawColour(int number, int salt) {
  return vec3(drawOf(number, salt), drawOf(number, salt + 1), drawOf(number, salt + 2));
}

Room buildRoom(int kind, int number, bool isLit, vec2 window) {
  bool isShop = kind == TEXTURE_SHOP;
  float sill = isShop ? SHOP_SILL : window.y > TALL_WINDOW ? TALL_SILL : SILL;
  vec3 low = vec3(-ROOM_ASIDE - drawOf(number, 1), -sill, 0.0);
  vec3 high = vec3(window + vec2(ROOM_ASIDE + drawOf(number, 2), ROOM_ABOVE),
      ROOM_DEPTH + ROOM_DEPTH_SPREAD * drawOf(number, 3));
  return Room(number, isShop, isLit, window, low, high);
}

// Corners of a piece of furniture: a cupboard and a table, or shelves and two stands behind the window.
void placePiece(Room r, int piece, out vec3 low, out vec3 high) {
  int salt = 10 + 8 * piece;
  vec3 size = vec3(1.2 + drawOf(r.number, salt), 0.75, 0.8);
  float nearest = 1.2;
  if (piece == 0) {
    size.y = 0.8 + 1.3 * drawOf(r.number, salt + 1);
    nearest = r.isShop ? 1.9 : r.high.z - 0.5;
    size.z = 0.5;
  } else if (r.isShop) {
    size = vec3(0.5 + 0.9 * drawOf(r.number, salt), 0.8 + 0.9 * drawOf(r.number, salt + 1), 0.4);
    nearest = 0.35;
  }
  float room = max(r.high.x - r.low.x - size.x, 0.0);
  low = vec3(r.low.x + room * drawOf(r.number, salt + 2), r.low.y, nearest);
  high = low + size;
}

RoomHit hitRoom(Room r, vec3 from, vec3 ray) {
  vec3 per = 1.0 / (ray + vec3(equal(ray, vec3(0.0))) * 1e-6);
  vec3 exits = (mix(r.low, r.high, greaterThan(ray, vec3(0.0))) - from) * per;
  float ends = min(min(exits.x, exits.y), exits.z);
  RoomHit found = RoomHit(ends, -sign(ray) * vec3(lessThanEqual(exits, vec3(ends))), -1);
  int count = r.isShop ? 3 : 2;
  for (int i = 0; i < count; ++i) {
    vec3 low, high;
    placePiece(r, i, low, high);
    vec3 one = (low - from) * per, other = (high - from) * per, first = min(one, other);
    vec3 last = max(one, other);
    float enters = max(max(first.x, first.y), first.z);
    float leaves = min(min(last.x, last.y), min(last.z, found.distance));
    if (enters > 0.0 && enters < leaves) {
      found = RoomHit(enters, -sign(ray) * vec3(greaterThanEqual(first, vec3(enters))), i);
    }
  }
  return found;
}

// Goods on shelves, at metres along them and above the floor.
vec3 goodsAlbedo(int number, vec2 at, float width) {
  const vec2 CELL = vec2(0.17, 0.36);
  const vec3 MEAN = vec3(0.33);
  ivec2 cell = wholeNumber(floor(at / CELL));
  float above = at.y - float(cell.y) * CELL.y;
  int third = wholeNumber(floor(float(cell.x) / 3.0));
  int good = number + 31 * third + 57 * cell.y, one = number + 13 * cell.x + 57 * cell.y;
  vec3 albedo = 0.08 + 0.35 * drawColour(good, 40) + 0.3 * drawOf(one, 43);
  if (above > 0.16 + 0.14 * drawOf(one, 44)) albedo = vec3(0.12);
  if (above < 0.03) albedo = vec3(0.6);
  return mix(MEAN, albedo, retainedContrast(0.6, width));
}

vec3 wallAlbedo(Room r, vec2 at, int side, float width) {
  vec3 paint = 0.45 + 0.35 * vec3(drawOf(r.number, 4)) + 0.12 * (drawColour(r.number, 5) - 0.5);
  if (r.isShop) return at.y < 2.0 ? goodsAlbedo(r.number + side, at, width) : paint;
  float door = 0.3 + 1.5 * drawOf(r.number, 50 + side);
  if (at.x > door && at.x < door + 0.9 && at.y < 2.05) return vec3(0.35, 0.24, 0.15);
  float picture = floor(at.x / 1.1);
  int key = r.number + 17 * wholeNumber(picture) + 71 * side;
  vec2 off = abs(vec2(at.x - (picture + 0.5) * 1.1, at.y - 1.6));
  vec2 size = 0.15 + 0.25 * vec2(drawOf(key, 60), drawOf(key, 61));
  bool isHung = drawOf(key, 62) < 0.5 && at.x > door + 0.9 && off.x < size.x && off.y < size.y;
  return isHung ? 0.05 + 0.6 * drawColour(key, 63) : paint;
}

vec3 roomSurfaceAlbedo(Room r, RoomHit hit, vec3 at, float width) {
  vec2 place = vec2(abs(hit.normal.x) > 0.5 ? at.z : at.x - r.low.x, at.y - r.low.y);
  if (hit.piece >= 0) {
    if (r.isShop) return goodsAlbedo(r.number + 5 * hit.piece, place, width);
    vec3 wood = mix(vec3(0.22, 0.13, 0.08), vec3(0.6, 0.55, 0.48), drawOf(r.number, 70 + hit.piece));
    return fract(place.x / 0.6) < 0.03 ? 0.4 * wood : wood;
  }
  if (hit.normal.y > 0.5) return mix(vec3(0.3, 0.19, 0.11), vec3(0.4), drawOf(r.number, 80));
  if (hit.normal.y < -0.5) return vec3(0.75);
  return wallAlbedo(r, place, wholeNumber(hit.normal.x) + 1, width);
}

// Light on a surface relative to that on the pane: what the window sends there and, by the split-flux
// method, what the room reflects; shops have lamps by day, too. By night relative to the mean of the lamp
// under the ceiling.
float roomLight(Room r, vec3 at, vec3 normal) {
  vec3 source = r.isLit ? vec3(0.5 * (r.low.x + r.high.x), r.high.y - 0.5, 0.5 * r.high.z)
      : vec3(0.5 * r.window, 0.0);
  vec3 away = at - source;
  float square = dot(away, away), facing = max(-dot(normal, away), 0.0);
  if (r.isLit) return 0.5 + 1.3 * facing * inversesqrt(square + 0.01) / (0.5 + square);
  vec3 size = r.high - r.low;
  float area = r.window.x * r.window.y;
  float all = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
  float direct = max(away.z, 0.0) * facing / (square * (PI * square + area) + 1e-3);
  return area * (direct + 1.0 / all) + (r.isShop ? SHOP_DAY_RATIO : 0.0);
}

// Albedo that the curtains or the blind of a window seem to have, or -1 where nothing covers it.
//   cover: 0 for nothing, 1 for a curtain at either side, else 1 more than eighths that a blind covers
vec3 coverAlbedo(Room r, int cover, vec3 base, vec3 at, float width) {
  float aside = min(at.x, r.window.x - at.x) / r.window.x;
  bool isCovered = cover == 1 ? aside < CURTAIN_FRACTION
      : cover > 1 && at.y > r.window.y * (1.0 - float(cover - 1) / BLIND_STEPS);
  if (!isCovered) return vec3(-1.0);
  float fold = cover == 1 ? 0.15 * retainedContrast(0.14, width) * sin(45.0 * at.x) : 0.0;
  vec3 cloth = mix(vec3(0.62, 0.60, 0.55), vec3(0.42, 0.37, 0.31), drawOf(r.number, 90)) * (1.0 + fold);
  return r.isLit ? BLIND_RATIO * base * cloth / MEAN_CLOTH : WINDOW_TRANSMITTANCE * cloth;
}

// Albedo that a pane seems to have by what is behind it. `base` is the mean, which it fades to.
vec3 roomAlbedo(int kind, vec3 base, bool isLit, MapPlane plane, vec3 n, vec3 ray, float width) {
  if (plane.scale.x <= 0.0) return base;
  ivec2 code = wholeNumber(floor(plane.at));
  vec2 window = 0.5 * plane.scale;
  Room r = buildRoom(kind, code.x, isLit, window);
  vec3 from = vec3((2.0 * (plane.at - vec2(code)) - 0.5) * window, 0.0);
  vec3 along = vec3(ray * plane.axes, max(-dot(ray, n), 0.02));
  vec3 cover = coverAlbedo(r, code.y, base, from + along * (COVER_DEPTH / along.z), width);
  if (cover.r >= 0.0) return cover;
  float fraction = retainedContrast(1.5, width);
  if (fraction <= 0.0) return base;
  RoomHit hit = hitRoom(r, from, along);
  vec3 at = from + along * hit.distance;
  vec3 seen = roomSurfaceAlbedo(r, hit, at, width) * roomLight(r, at, hit.normal);
  return mix(base, isLit ? base * seen / (r.isShop ? MEAN_SHOP : MEAN_ROOM)
      : WINDOW_TRANSMITTANCE * seen, fraction);
}
