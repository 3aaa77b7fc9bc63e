"""Traces paths of light from a camera through the placed scene: the kernels of an image."""

from dataclasses import dataclass, replace
from typing import Any

from advercity.materials import Texture
from advercity_mitsuba.detail import compute_detail
from advercity_mitsuba.geometry import SEMANTIC_SHIFT, DeviceTables
from advercity_mitsuba.images import DeviceImages, is_unordered, sample_images
from advercity_mitsuba.lamps import (
    HOUSING_M,
    LOBES,
    LampTables,
    choose_lamp,
    compute_glow,
    compute_illuminance,
    fetch_lamp,
)
from advercity_mitsuba.light import (
    Light,
    compute_airlight,
    compute_transmittance,
    look_up_sky,
)
from advercity_mitsuba.placement import PlacedFrame
from advercity_mitsuba.reflection import (
    GLASS_TRANSMITTANCE,
    Surface,
    build_pane_face,
    compute_pane_reflectance,
    compute_specular_reflectance,
    evaluate,
    sample_bounce,
)
from advercity_mitsuba.surfaces import COLUMNS, SurfaceFlag
from advercity_mitsuba.variant import dr, mi
from advercity_mitsuba.weathering import WeatherTables, build_surface

FAR_M = 3000.0
"""Depth up to which cameras see."""
MAX_PANES = 6
MIRROR_ALPHA = 0.1
"""Lobes narrower than this show lamps where paths hit their lenses; wider ones sample the lamps, so
that no light is counted twice."""
LEAST_THROUGHPUT = 1e-5
AVERAGED_FOOTPRINT_M = 0.5
"""After the first hit texture is averaged: it would only add noise."""
LEVEL_SLOPE, STEEP_SLOPE = 0.3, 0.7
"""Sines of slopes up to which surfaces of ordered and unordered patterns count as level."""
UNDEFLECTED_DEPTH_LIMIT = 8.0


@dataclass(frozen=True, eq=False)
class Scene:
    """All that a kernel reads."""

    placed: PlacedFrame
    visible: Any
    tables: DeviceTables
    images: DeviceImages
    octaves: Any
    light: Light
    weather: WeatherTables
    lamps: LampTables | None
    glow_chances: Any


@dataclass(frozen=True, eq=False)
class Camera:
    """Pose and lens: eye, axes ahead, left and up, and half the width and height at 1 m."""

    eye: Any
    ahead: Any
    left: Any
    up: Any
    half_width: Any
    half_height: Any
    width_px: Any
    height_px: Any


@dataclass
class Crossing:
    """What a ray meets first: Mitsuba's numbers of the triangle and its instance."""

    distance: Any
    triangle: Any
    instance: Any
    barycentric: Any


@dataclass
class Hit:
    """A surface that a ray hits; its normal faces where the ray came from."""

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
    semantic: Any
    actor: Any


def trace(scene: Any, origin: Any, direction: Any, active: Any, *, coherent: bool) -> Crossing:
    """Find what rays meet first; the distance is infinite for the sky."""
    ray = mi.Ray3f(origin, direction, mi.Float(FAR_M), 0.0, [])
    found = scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
    return Crossing(
        found.t,
        found.prim_index,
        dr.reinterpret_array(mi.UInt32, found.instance),
        mi.Point2f(found.prim_uv),
    )


def is_visible(scene: Scene, origin: Any, direction: Any, distance: Any, active: Any) -> Any:
    """Whether nothing is between points and what lies in a direction at a distance."""
    ray = mi.Ray3f(origin, direction, distance, 0.0, [])
    return active & ~scene.placed.scene.ray_test(ray, active)


def _fetch_hit(scene: Scene, crossing: Crossing, origin: Any, ray: Any, active: Any) -> Hit:
    """Look up the surface of a crossing."""
    placed, tables = scene.placed, scene.tables
    row = dr.gather(mi.UInt32, placed.rows, crossing.instance, active)
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
    # Of a painted part the mesh has the images alone.
    albedo, second = dr.select(painted, paint[0], first), dr.select(painted, paint[1], second)
    kind, flags = mi.UInt32(second.y), mi.UInt32(second.w)
    # Leaves have the normal of their crown, on the side that is seen.
    back = dr.dot(dr.select(kind == int(Texture.LEAVES), normal, dr.cross(step1, step2)), ray) > 0.0
    normal = dr.select(back, -normal, normal)
    lens = dr.gather(mi.Float, placed.luminances, row * 8 + mi.UInt32(second.z), active)
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
        semantic=triangle.w >> SEMANTIC_SHIFT,
        actor=own.y,
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
    # Triangles that are a point of the image have no axes of their own.
    return dr.select(dr.squared_norm(right) < 1e-20, other, right)


def _build_first_surface(
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


def build_camera_ray(camera: Camera, pixel: Any, offset: Any) -> tuple[Any, Any]:
    """Build the ray through a point of each pixel, and its length per metre of depth."""
    column, row = mi.Float(pixel % camera.width_px), mi.Float(pixel // camera.width_px)
    u = 2.0 * (column + offset.x) / mi.Float(camera.width_px) - 1.0
    v = 2.0 * (row + offset.y) / mi.Float(camera.height_px) - 1.0
    left, up = -u * camera.half_width, -v * camera.half_height
    ray = camera.ahead + left * camera.left + up * camera.up
    length = dr.norm(ray)
    return ray / length, length


@dataclass(frozen=True, eq=False)
class Guides:
    """Geometry at the middles of pixels."""

    depth: Any
    normal: Any
    albedo: Any
    semantic: Any
    actor: Any


def trace_guides(scene: Scene, camera: Camera, pixel: Any) -> Guides:
    """Find what the middles of pixels show; depth and actor are 0 for the sky."""
    ray, length = build_camera_ray(camera, pixel, mi.Point2f(0.5))
    crossing = trace(scene.visible, camera.eye, ray, mi.Bool(True), coherent=True)
    seen = crossing.distance < FAR_M
    hit = _fetch_hit(scene, crossing, camera.eye, ray, seen)
    angle = 2.0 * camera.half_width / mi.Float(camera.width_px)
    s = _build_first_surface(scene, hit, ray, crossing.distance, angle, seen)
    shine = compute_specular_reflectance(s, dr.abs(dr.dot(ray, s.normal)))
    return Guides(
        depth=dr.select(seen, crossing.distance / length, 0.0),
        normal=dr.select(seen, hit.normal, 0.0),
        albedo=dr.select(seen, dr.minimum(s.albedo + shine, 1.0), 1.0),
        semantic=dr.select(seen, hit.semantic, 0),
        actor=dr.select(seen, hit.actor, 0),
    )


def _compute_sunlight(scene: Scene, s: Surface, eye: Any, position: Any, active: Any) -> Any:
    light = scene.light
    if not light.has_sun:
        return mi.Color3f(0.0)
    reflected = evaluate(s, eye, light.sun_direction) * light.sun_irradiance
    active = active & (reflected.y > 0.0)
    lit = is_visible(scene, position, light.sun_direction, mi.Float(FAR_M), active)
    return dr.select(lit, reflected, 0.0)


def _compute_lamplight(
    scene: Scene, s: Surface, eye: Any, position: Any, random: Any, active: Any
) -> tuple[Any, Any]:
    assert scene.lamps is not None
    row, weight, random = choose_lamp(scene.light, scene.lamps, position, s.normal, random, active)
    active = active & (weight > 0.0)
    lamp = fetch_lamp(scene.lamps, row, active)
    lux, direction, distance = compute_illuminance(scene.light, lamp, position)
    reflected = evaluate(s, eye, direction) * lux * weight
    reached = distance - HOUSING_M
    active = active & (dr.sum(reflected) > 0.0)
    hidden = active & (reached > 0.0)
    lit = active & (~hidden | is_visible(scene, position, direction, reached, hidden))
    return dr.select(lit, reflected, 0.0), random


def trace_radiance(
    scene: Scene, camera: Camera, pixel: Any, *, samples: Any, path_depth: Any, seed: Any
) -> Any:
    """Trace paths through pixels; returns their mean radiance."""

    def add_sample(number: Any, random: Any, total: Any) -> tuple[Any, Any, Any]:
        offset = mi.Point2f(0.5) + mi.Float(number) * mi.Point2f(0.75487767, 0.56984029)
        ray, _ = build_camera_ray(camera, pixel, offset - dr.floor(offset))
        path = _trace_path(scene, camera, ray, path_depth, random)
        return number + 1, path.random, total + path.radiance

    def goes_on(number: Any, *_: Any) -> Any:
        return number < samples

    random = mi.PCG32(initstate=mi.UInt64(seed), initseq=mi.UInt64(pixel))
    _, _, total = dr.while_loop(
        (mi.UInt32(0), random, mi.Color3f(0.0)),
        goes_on,
        add_sample,
        labels=("number", "random", "total"),
    )
    return total / mi.Float(samples)


@dataclass
class _Path:
    """A path on its way; its radiance is what it has found so far."""

    origin: Any
    direction: Any
    crossing: Crossing
    radiance: Any
    throughput: Any
    depth: Any
    panes: Any
    mirrored: Any
    sees_lenses: Any
    travelled: Any
    active: Any
    random: Any


def _trace_path(
    scene: Scene, camera: Camera, direction: Any, path_depth: Any, random: Any
) -> _Path:
    """Trace a path from the camera to its end."""

    def cross_pane(path: _Path, hit: Hit) -> _Path:
        return _cross_pane(scene, path, hit)

    def reflect(path: _Path, hit: Hit) -> _Path:
        return _reflect(scene, camera, path, hit, path_depth)

    def see_sky(path: _Path) -> _Path:
        return _see_sky(scene, path)

    def meet_surface(path: _Path) -> _Path:
        path = _cross_air(scene, path)
        hit = _fetch_hit(scene, path.crossing, path.origin, path.direction, path.active)
        is_pane = ((hit.flags & int(SurfaceFlag.PANE)) != 0) & (path.panes < MAX_PANES)
        return _advance(scene, dr.if_stmt((path, hit), is_pane, cross_pane, reflect))

    def step(path: _Path) -> tuple[_Path]:
        is_surface = path.crossing.distance < FAR_M
        return (dr.if_stmt((path,), is_surface, meet_surface, see_sky),)

    def goes_on(path: _Path) -> Any:
        return path.active

    start = _start_path(scene, camera, direction, random)
    (end,) = dr.while_loop((start,), goes_on, step, labels=("path",))
    return end


def _start_path(scene: Scene, camera: Camera, direction: Any, random: Any) -> _Path:
    origin, light = mi.Point3f(camera.eye), scene.light
    crossing = trace(scene.visible, origin, direction, mi.Bool(True), coherent=True)
    radiance = mi.Color3f(0.0)
    if light.night and light.has_air and scene.lamps is not None:
        range_m = dr.minimum(crossing.distance, FAR_M)
        radiance, random = compute_glow(
            light, scene.lamps, scene.glow_chances, origin, direction, range_m, random
        )
    return _Path(
        origin=origin,
        direction=mi.Vector3f(direction),
        crossing=crossing,
        radiance=radiance,
        throughput=mi.Color3f(1.0),
        depth=mi.UInt32(0),
        panes=mi.UInt32(0),
        mirrored=mi.Bool(True),
        sees_lenses=mi.Bool(True),
        travelled=mi.Float(0.0),
        active=mi.Bool(True),
        random=random,
    )


def _see_sky(scene: Scene, path: _Path) -> _Path:
    seen = path.throughput * look_up_sky(scene.light, path.direction)
    return replace(path, radiance=path.radiance + seen, active=mi.Bool(False))


def _cross_air(scene: Scene, path: _Path) -> _Path:
    light, distance = scene.light, path.crossing.distance
    if not light.has_air:
        return path
    added = path.throughput * compute_airlight(light, path.direction, distance)
    left = compute_transmittance(light, distance)
    return replace(path, radiance=path.radiance + added, throughput=path.throughput * left)


def _offset(path: _Path) -> Any:
    """Compute how far from a surface its next ray starts, metres."""
    return 1e-3 + 1e-5 * path.crossing.distance


def _cross_pane(scene: Scene, path: _Path, hit: Hit) -> _Path:
    """Pass a pane of glass, or be mirrored by it."""
    direction, away = path.direction, _offset(path)
    outside = hit.position + away * hit.normal
    face = build_pane_face(hit.normal)
    shine = _compute_sunlight(scene, face, -direction, outside, path.active)
    cosine = dr.dot(direction, hit.normal)
    reflected = path.random.next_float32() < compute_pane_reflectance(cosine)
    mirror = direction - 2.0 * cosine * hit.normal
    return replace(
        path,
        origin=mi.Point3f(hit.position + away * dr.select(reflected, hit.normal, direction)),
        direction=mi.Vector3f(dr.select(reflected, mirror, direction)),
        radiance=path.radiance + path.throughput * shine,
        throughput=path.throughput * dr.select(reflected, 1.0, GLASS_TRANSMITTANCE),
        panes=path.panes + 1,
    )


def _build_path_surface(scene: Scene, camera: Camera, path: _Path, hit: Hit) -> Surface:
    angle = 2.0 * camera.half_width / mi.Float(camera.width_px)

    def build_first(path: _Path, hit: Hit) -> Surface:
        distance = path.crossing.distance
        return _build_first_surface(scene, hit, path.direction, distance, angle, path.active)

    def build_next(path: _Path, hit: Hit) -> Surface:
        footprint = mi.Float(AVERAGED_FOOTPRINT_M)
        return _build_surface(scene, hit, hit.albedo, hit.roughness, hit.normal, footprint)

    s = dr.if_stmt((path, hit), path.depth == 0, build_first, build_next)
    # After a diffuse bounce mirrors would only add bright single pixels.
    return replace(s, alpha=dr.select(path.mirrored, s.alpha, dr.maximum(s.alpha, 0.5)))


def _reflect(scene: Scene, camera: Camera, path: _Path, hit: Hit, path_depth: Any) -> _Path:
    """Add the light that a surface sends back, and draw where the path goes on."""
    light, away, random = scene.light, _offset(path), path.random
    s = _build_path_surface(scene, camera, path, hit)
    eye = -path.direction
    found = dr.select(path.sees_lenses, hit.emission * hit.albedo, 0.0)
    # The normal of a crown may point behind the leaf: towards the sun is before what hides it.
    is_leaf = s.through > 0.0
    shown = dr.select(is_leaf, light.sun_direction, hit.normal) if light.has_sun else hit.normal
    outside = hit.position + away * shown
    found += _compute_sunlight(scene, s, eye, outside, path.active)
    travelled = path.travelled + path.crossing.distance
    if light.night and scene.lamps is not None:
        # What is deflected a little still arrives.
        narrow = LOBES.narrow_fraction * light.extinction * travelled
        kept = dr.exp(dr.minimum(narrow, UNDEFLECTED_DEPTH_LIMIT))
        lit, random = _compute_lamplight(
            scene, _without_mirror(s), eye, outside, random, path.active
        )
        found += kept * lit
    direction, factor, mirrored = sample_bounce(s, path.direction, random)
    throughput, depth = path.throughput * factor, path.depth + 1
    is_mirror = s.alpha < MIRROR_ALPHA if light.night else mi.Bool(True)
    return replace(
        path,
        origin=mi.Point3f(hit.position + away * dr.select(is_leaf, direction, hit.normal)),
        direction=mi.Vector3f(direction),
        radiance=path.radiance + path.throughput * found,
        throughput=throughput,
        depth=depth,
        mirrored=mirrored,
        sees_lenses=mirrored & is_mirror,
        travelled=travelled,
        random=random,
        active=path.active & (depth <= path_depth) & (dr.sum(throughput) > LEAST_THROUGHPUT),
    )


def _advance(scene: Scene, path: _Path) -> _Path:
    """Find what the path meets next; hidden actors are hidden from camera rays alone."""
    found = trace(scene.placed.scene, path.origin, path.direction, path.active, coherent=False)
    return replace(path, crossing=found)


def _without_mirror(s: Surface) -> Surface:
    narrow = s.alpha < MIRROR_ALPHA
    return Surface(
        s.albedo,
        s.alpha,
        dr.select(narrow, 0.0, s.coat),
        s.index,
        dr.select(narrow, 0.0, s.metal),
        s.normal,
        s.through,
    )
