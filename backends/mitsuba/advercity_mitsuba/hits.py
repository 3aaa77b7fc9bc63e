"""Hits of rays: the triangle, its instance, and its surface at the point."""

from dataclasses import dataclass, replace
from typing import Any

from advercity.materials import Texture
from advercity.rendering.lamp_lenses import LENS_COUNT
from advercity_mitsuba.detail import compute_detail
from advercity_mitsuba.geometry import SEMANTIC_SHIFT, DeviceTables
from advercity_mitsuba.images import DeviceImages, is_unordered, sample_images
from advercity_mitsuba.lamps import LampTables
from advercity_mitsuba.light import Light
from advercity_mitsuba.placement import PlacedFrame
from advercity_mitsuba.reflection import Surface
from advercity_mitsuba.rooms import compute_room_albedo
from advercity_mitsuba.surfaces import COLUMNS, SurfaceFlag
from advercity_mitsuba.variant import dr, mi
from advercity_mitsuba.weathering import WeatherTables, build_surface

FAR_M = 3000.0
"""Depth up to which cameras see."""
AVERAGED_FOOTPRINT_M = 0.5
"""After the first hit texture is averaged: it would only add noise."""
BLADE_COSINE = 0.3
"""Cosine of the angle between normal and triangle up to which crops are a blade, not a field."""
LEVEL_SLOPE, STEEP_SLOPE = 0.3, 0.7
"""Sines of slopes up to which surfaces of ordered and unordered patterns count as level."""


@dataclass(frozen=True, eq=False)
class Scene:
    """All inputs of a kernel.

    Attributes:
        hidden: Whether an instance is invisible to the camera, by row.
        glow_chances: Cumulative chances of lamps by their glow in the image.
    """

    placed: PlacedFrame
    tables: DeviceTables
    images: DeviceImages
    octaves: Any
    light: Light
    weather: WeatherTables
    lamps: LampTables | None
    glow_chances: Any
    hidden: Any


@dataclass
class Crossing:
    """The first hit of a ray: Mitsuba's numbers of the triangle and its instance."""

    distance: Any
    triangle: Any
    instance: Any
    barycentric: Any


@dataclass
class Hit:
    """A surface hit by a ray; its normal faces the ray's origin.

    Attributes:
        scale: Metres per unit of the mesh's own coordinates, 0 without any.
        is_thin: Whether it is a leaf or a blade, whose normal says nothing of its sides.
    """

    position: Any
    normal: Any
    albedo: Any
    roughness: Any
    metallic: Any
    kind: Any
    flags: Any
    emission: Any
    image: Any
    width_m: Any
    at: Any
    right: Any
    scale: Any
    semantic: Any
    actor: Any
    is_thin: Any


def trace(scene: Any, origin: Any, direction: Any, active: Any, *, coherent: bool) -> Crossing:
    """Find the first hits of rays; the distance is infinite for the sky."""
    ray = mi.Ray3f(origin, direction, mi.Float(FAR_M), 0.0, [])
    found = scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
    return Crossing(
        found.t,
        found.prim_index,
        dr.reinterpret_array(mi.UInt32, found.instance),
        mi.Point2f(found.prim_uv),
    )


def is_visible(scene: Scene, origin: Any, direction: Any, distance: Any, active: Any) -> Any:
    """Whether the way from points in a direction is free up to a distance."""
    ray = mi.Ray3f(origin, direction, distance, 0.0, [])
    return active & ~scene.placed.scene.ray_test(ray, active)


def find_row(scene: Scene, crossing: Crossing, active: Any) -> Any:
    """Find the row of the instance of a crossing."""
    return dr.gather(mi.UInt32, scene.placed.rows, crossing.instance, active)


def fetch_hit(scene: Scene, crossing: Crossing, origin: Any, ray: Any, active: Any) -> Hit:
    """Look up the surface of a crossing."""
    placed, tables = scene.placed, scene.tables
    row = find_row(scene, crossing, active)
    own = dr.gather(mi.Vector4u, placed.words, row, active)
    triangle = dr.gather(mi.Vector4u, tables.corners, own.x + crossing.triangle, active)
    corners = (triangle.x, triangle.y, triangle.z)
    low = [dr.gather(mi.Vector4f, tables.vertices, 2 * corner, active) for corner in corners]
    high = [dr.gather(mi.Vector4f, tables.vertices, 2 * corner + 1, active) for corner in corners]
    u, v = crossing.barycentric
    weights = (1.0 - u - v, u, v)
    mixed = low[0] * weights[0] + low[1] * weights[1] + low[2] * weights[2]
    across = high[0].w * weights[0] + high[1].w * weights[1] + high[2].w * weights[2]
    pose = [dr.gather(mi.Vector4f, placed.poses, 3 * row + n, active) for n in range(3)]

    def rotate(x: Any, y: Any, z: Any) -> Any:
        return mi.Vector3f(*(p.x * x + p.y * y + p.z * z for p in pose))

    def edge(corner: int) -> Any:
        step = high[corner] - high[0]
        return rotate(step.x, step.y, step.z)

    step1, step2 = edge(1), edge(2)
    normal = dr.normalize(rotate(mixed.x, mixed.y, mixed.z))
    surface_row = triangle.w & ((1 << SEMANTIC_SHIFT) - 1)
    first, second, third = _fetch_surface(tables, surface_row, active)
    painted = (mi.UInt32(second.w) & int(SurfaceFlag.PAINTED)) != 0
    paint = _fetch_surface(tables, own.z, active & painted)
    # A painted part takes only its images from the mesh.
    albedo, second = dr.select(painted, paint[0], first), dr.select(painted, paint[1], second)
    kind, flags = mi.UInt32(second.y), mi.UInt32(second.w)
    face = dr.normalize(dr.cross(step1, step2))
    is_leaf = kind == int(Texture.LEAVES)
    is_blade = (kind == int(Texture.CROPS)) & (dr.abs(dr.dot(normal, face)) < BLADE_COSINE)
    # Leaves have their crown's normal, on the visible side; blades the field's, on both sides.
    back = dr.dot(dr.select(is_leaf, normal, face), ray) > 0.0
    normal = dr.select(back & ~is_blade, -normal, normal)
    lens = dr.gather(mi.Float, placed.luminances, row * LENS_COUNT + mi.UInt32(second.z), active)
    position = origin + ray * crossing.distance
    along_world = third.y > 0.0
    at, right = _find_world_plane(kind, position, normal)
    uv_steps = [mi.Vector2f(low[n].w - low[0].w, high[n].w - high[0].w) for n in (1, 2)]
    mesh_right = _find_mesh_axis(normal, step1, step2, *uv_steps)
    return Hit(
        position=position,
        normal=normal,
        albedo=mi.Color3f(albedo.x, albedo.y, albedo.z),
        roughness=albedo.w,
        metallic=second.x,
        kind=kind,
        flags=flags,
        emission=lens,
        image=third.x,
        width_m=dr.abs(third.y),
        at=dr.select(along_world, at, mi.Point2f(mixed.w, across)),
        right=dr.select(along_world, right, mesh_right),
        scale=_find_scale(step1, step2, *uv_steps),
        semantic=triangle.w >> SEMANTIC_SHIFT,
        actor=own.y,
        is_thin=is_leaf | is_blade,
    )


def _fetch_surface(tables: DeviceTables, row: Any, active: Any) -> list[Any]:
    parts = COLUMNS // 4
    return [dr.gather(mi.Vector4f, tables.surfaces, parts * row + n, active) for n in range(parts)]


def _find_world_plane(kind: Any, p: Any, n: Any) -> tuple[Any, Any]:
    """Find coordinates along the world's axes on surfaces, and the direction of the first.

    Courses run level on walls and roofs of any direction; grains lie along the nearest axis, as
    normals of smooth surfaces turn.
    """
    slope = dr.sqrt(n.x * n.x + n.y * n.y)
    unordered = is_unordered(kind)
    level = slope < dr.select(unordered, mi.Float(STEEP_SLOPE), LEVEL_SLOPE)
    safe = dr.maximum(slope, 1e-6)
    course = mi.Point2f((p.y * n.x - p.x * n.y) / safe, p.z / safe)
    along_y = dr.abs(n.x) > dr.abs(n.y)
    grain = dr.select(
        along_y,
        mi.Vector3f(0.0, dr.sign(n.x), 0.0),
        mi.Vector3f(-dr.sign(n.y), 0.0, 0.0),
    )
    wall = dr.select(unordered, mi.Point2f(dr.dot(mi.Vector3f(p), grain), p.z), course)
    steep = dr.select(unordered, grain, mi.Vector3f(-n.y, n.x, 0.0))
    right = dr.select(level, mi.Vector3f(1.0, 0.0, 0.0), steep)
    return dr.select(level, mi.Point2f(p.x, p.y), wall), right


def _find_mesh_axis(n: Any, step1: Any, step2: Any, uv_step1: Any, uv_step2: Any) -> Any:
    """Find the direction of a mesh's first coordinate, of which two steps are known."""
    right = step1 * uv_step2.y - step2 * uv_step1.y
    turned = uv_step1.x * uv_step2.y - uv_step2.x * uv_step1.y
    right = dr.select(turned < 0.0, -right, right)
    other = dr.select(dr.abs(n.z) < 0.9, mi.Vector3f(-n.y, n.x, 0.0), mi.Vector3f(1.0, 0.0, 0.0))
    # Triangles with a single point in the image have no axes of their own.
    return dr.select(dr.squared_norm(right) < 1e-20, other, right)


def _find_scale(step1: Any, step2: Any, uv_step1: Any, uv_step2: Any) -> Any:
    """Find how many metres a unit of either coordinate of a mesh is, 0 where it has none."""
    turned = uv_step1.x * uv_step2.y - uv_step2.x * uv_step1.y
    right = step1 * uv_step2.y - step2 * uv_step1.y
    up = step2 * uv_step1.x - step1 * uv_step2.x
    metres = mi.Vector2f(dr.norm(right), dr.norm(up)) / dr.abs(turned)
    return dr.select(turned == 0.0, 0.0, metres)


def apply_room(hit: Hit, ray: Any, pixel_m: Any) -> Hit:
    """Give panes of buildings the albedo of the rooms visible behind them."""
    right = dr.normalize(hit.right - hit.normal * dr.dot(hit.right, hit.normal))
    found = compute_room_albedo(
        kind=hit.kind,
        base=hit.albedo,
        is_lit=hit.emission > 0.0,
        at=hit.at,
        scale=hit.scale,
        axes=(right, dr.cross(hit.normal, right), hit.normal),
        ray=ray,
        pixel_m=pixel_m,
    )
    return replace(hit, albedo=found)


def build_first_surface(
    scene: Scene, hit: Hit, ray: Any, distance: Any, pixel_angle: Any, active: Any
) -> Surface:
    """Build the surface of a first hit, with its images."""
    cosine = dr.abs(dr.dot(ray, hit.normal))
    found = sample_images(
        scene.images,
        hit.image,
        at=hit.at,
        width_m=dr.maximum(hit.width_m, 1e-3),
        kind=hit.kind,
        cosine=cosine,
        pixel_m=pixel_angle * distance,
        active=active & (hit.image >= 0.0),
    )
    right = dr.normalize(hit.right - hit.normal * dr.dot(hit.right, hit.normal))
    up = dr.cross(hit.normal, right)
    out = dr.sqrt(dr.maximum(1.0 - dr.squared_norm(found.slope), 0.01))
    relief = dr.normalize(right * found.slope.x + up * found.slope.y + hit.normal * out)
    bent = dr.squared_norm(found.slope) > 0.0
    footprint = pixel_angle * distance * dr.maximum(cosine, 0.02) ** -0.7
    detail = compute_detail(
        scene.octaves,
        scene.weather,
        hit.kind,
        hit.image >= 0.0,
        hit.position,
        hit.normal,
        footprint,
    )
    return _build_surface(
        scene,
        hit,
        dr.minimum(hit.albedo * found.color, 1.0) * detail,
        dr.minimum(hit.roughness * found.roughness, 1.0),
        dr.select(bent, relief, hit.normal),
        footprint,
    )


def build_next_surface(scene: Scene, hit: Hit) -> Surface:
    """Build the surface of a hit after the first, with its means."""
    footprint = mi.Float(AVERAGED_FOOTPRINT_M)
    return _build_surface(scene, hit, hit.albedo, hit.roughness, hit.normal, footprint)


def _build_surface(
    scene: Scene, hit: Hit, albedo: Any, roughness: Any, relief: Any, footprint: Any
) -> Surface:
    return build_surface(
        scene.weather,
        albedo=albedo,
        roughness=roughness,
        metallic=hit.metallic,
        kind=hit.kind,
        snowless=(hit.flags & int(SurfaceFlag.SNOWLESS)) != 0,
        position=hit.position,
        normal=hit.normal,
        relief=relief,
        footprint=footprint,
    )
