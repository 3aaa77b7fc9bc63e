"""Traces paths of light from a camera through the placed scene: the kernel of an image."""

from dataclasses import dataclass, replace
from typing import Any

from advercity_mitsuba.camera import Camera, build_camera_ray, compute_pixel_angle, trace_visible
from advercity_mitsuba.hits import (
    FAR_M,
    Crossing,
    Hit,
    Scene,
    apply_room,
    build_first_surface,
    build_next_surface,
    fetch_hit,
    is_visible,
    trace,
)
from advercity_mitsuba.lamps import (
    HOUSING_M,
    LOBES,
    choose_lamp,
    compute_deflection_density,
    compute_forward_spread,
    compute_glow,
    compute_illuminance,
    fetch_lamp,
)
from advercity_mitsuba.light import compute_airlight, compute_transmittance, look_up_sky
from advercity_mitsuba.reflection import (
    GLASS_TRANSMITTANCE,
    Surface,
    build_pane_face,
    compute_pane_reflectance,
    evaluate,
    sample_bounce,
)
from advercity_mitsuba.rooms import is_room
from advercity_mitsuba.surfaces import SurfaceFlag
from advercity_mitsuba.variant import dr, mi

MAX_PANES = 6
GOLDEN_RATIO = 0.61803399
"""Steps of this much are even in [0, 1) after any number of them."""
FIRST_MIRRORED = 0.5
"""Fraction of samples mirrored by the first pane: most glass mirrors less, but a bright sky."""
MIRROR_ALPHA = 0.1
"""Lobes narrower than this show lamps where paths hit their lenses; wider ones sample the lamps: no
light is counted twice."""
LEAST_THROUGHPUT = 1e-5
UNDEFLECTED_DEPTH_LIMIT = 8.0
MOST_DEFLECTED, DRAWN_DISTANCE_M = 0.97, 60.0
"""Sampled fraction of deflected light, and the distance for the drawn angles."""


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
    lamp = fetch_lamp(scene.lamps.lamps, row, active)
    lux, direction, distance = compute_illuminance(scene.light, lamp, position)
    reflected = evaluate(s, eye, direction) * lux * weight
    reached = distance - HOUSING_M
    active = active & (dr.sum(reflected) > 0.0)
    hidden = active & (reached > 0.0)
    lit = active & (~hidden | is_visible(scene, position, direction, reached, hidden))
    return dr.select(lit, reflected, 0.0), random


def _compute_deflected_light(
    scene: Scene, camera: Camera, ray: Any, distance: Any, random: Any
) -> tuple[Any, Any]:
    """Compute lamps' light on surfaces around a ray, deflected into it by fog; one more ray.

    Angles up to `MOST_DEFLECTED` of all are drawn by the spread at a limited distance.
    """
    light = scene.light
    near = LOBES.narrow_fraction * light.extinction * dr.minimum(distance, DRAWN_DISTANCE_M)
    spread = compute_forward_spread(near)
    rest = 1.0 - MOST_DEFLECTED * random.next_float32()
    angle = spread * (1.0 - rest * rest) / (2.0 * rest)
    sine, cosine = dr.sincos(angle)
    around_sine, around_cosine = dr.sincos(2.0 * dr.pi * random.next_float32())
    frame = mi.Frame3f(ray)
    found = dr.normalize(
        frame.to_world(mi.Vector3f(sine * around_cosine, sine * around_sine, cosine))
    )
    eye = mi.Point3f(camera.eye)
    crossing = trace_visible(scene, eye, found)
    seen = crossing.distance < FAR_M
    hit = fetch_hit(scene, crossing, eye, found, seen)
    depth = LOBES.narrow_fraction * light.extinction * crossing.distance
    weight = compute_deflection_density(angle, compute_forward_spread(depth))
    weight *= MOST_DEFLECTED / compute_deflection_density(angle, spread)
    weight *= 1.0 - dr.exp(-depth)
    weight *= dr.exp(-LOBES.wide_fraction * light.extinction * crossing.distance)
    outside = hit.position + (1e-3 + 1e-5 * crossing.distance) * hit.normal
    s = build_next_surface(scene, hit)
    lit, random = _compute_lamplight(scene, s, -found, outside, random, seen)
    return dr.select(seen, weight * lit, 0.0), random


def trace_radiance(
    scene: Scene, camera: Camera, pixel: Any, *, samples: Any, path_depth: Any, seed: Any
) -> tuple[Any, Any]:
    """Trace paths through pixels.

    Returns:
        Their mean radiance without lenses of lamps, and the light straight from lenses.
    """

    def add_sample(number: Any, random: Any, total: Any, lenses: Any) -> tuple[Any, ...]:
        offset = mi.Point2f(0.5) + mi.Float(number) * mi.Point2f(0.75487767, 0.56984029)
        ray, _ = build_camera_ray(camera, pixel, offset - dr.floor(offset))
        at_pane = first_at_pane + mi.Float(number) * GOLDEN_RATIO
        path = _trace_path(scene, camera, ray, path_depth, random, at_pane - dr.floor(at_pane))
        return number + 1, path.random, total + path.radiance, lenses + path.lenses

    def goes_on(number: Any, *_: Any) -> Any:
        return number < samples

    random = mi.PCG32(initstate=mi.UInt64(seed), initseq=mi.UInt64(pixel))
    first_at_pane = random.next_float32()
    _, _, total, lenses = dr.while_loop(
        (mi.UInt32(0), random, mi.Color3f(0.0), mi.Color3f(0.0)),
        goes_on,
        add_sample,
        labels=("number", "random", "total", "lenses"),
    )
    return total / mi.Float(samples), lenses / mi.Float(samples)


@dataclass
class _Path:
    """A path on its way.

    Attributes:
        radiance: Light found so far.
        lenses: In addition, light straight from the lens of a lamp to the camera.
        at_pane: Number in [0, 1) for the choice of the first pane, even over a pixel's samples.
    """

    origin: Any
    direction: Any
    crossing: Crossing
    radiance: Any
    lenses: Any
    throughput: Any
    depth: Any
    panes: Any
    at_pane: Any
    mirrored: Any
    sees_lenses: Any
    travelled: Any
    active: Any
    random: Any


def _trace_path(
    scene: Scene, camera: Camera, direction: Any, path_depth: Any, random: Any, at_pane: Any
) -> _Path:

    def cross_pane(path: _Path, hit: Hit) -> _Path:
        return _cross_pane(scene, path, hit)

    def reflect(path: _Path, hit: Hit) -> _Path:
        return _reflect(scene, camera, path, hit, path_depth)

    def see_sky(path: _Path) -> _Path:
        return _see_sky(scene, path)

    def meet_surface(path: _Path) -> _Path:
        path = _cross_air(scene, path)
        hit = fetch_hit(scene, path.crossing, path.origin, path.direction, path.active)
        is_pane = ((hit.flags & int(SurfaceFlag.PANE)) != 0) & (path.panes < MAX_PANES)
        return _advance(scene, dr.if_stmt((path, hit), is_pane, cross_pane, reflect))

    def step(path: _Path) -> tuple[_Path]:
        is_surface = path.crossing.distance < FAR_M
        return (dr.if_stmt((path,), is_surface, meet_surface, see_sky),)

    def goes_on(path: _Path) -> Any:
        return path.active

    start = _start_path(scene, camera, direction, random, at_pane)
    (end,) = dr.while_loop((start,), goes_on, step, labels=("path",))
    return end


def _start_path(scene: Scene, camera: Camera, direction: Any, random: Any, at_pane: Any) -> _Path:
    origin, light = mi.Point3f(camera.eye), scene.light
    crossing = trace_visible(scene, origin, direction)
    radiance = mi.Color3f(0.0)
    if light.night and light.has_air and scene.lamps is not None:
        range_m = dr.minimum(crossing.distance, FAR_M)
        radiance, random = compute_glow(
            light, scene.lamps, scene.glow_chances, origin, direction, range_m, random
        )
        if light.deflects:
            lit, random = _compute_deflected_light(scene, camera, direction, range_m, random)
            radiance += lit
    return _Path(
        origin=origin,
        direction=mi.Vector3f(direction),
        crossing=crossing,
        radiance=radiance,
        lenses=mi.Color3f(0.0),
        throughput=mi.Color3f(1.0),
        depth=mi.UInt32(0),
        panes=mi.UInt32(0),
        at_pane=mi.Float(at_pane),
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
    """Pass a pane of glass, or be mirrored by it.

    The first pane in view gets as many samples of either. If reflectance decided, the few samples
    of a bright sky would be speckles, in which the denoiser sees a pattern.
    """
    direction, away = path.direction, _offset(path)
    outside = hit.position + away * hit.normal
    face = build_pane_face(hit.normal)
    shine = _compute_sunlight(scene, face, -direction, outside, path.active)
    cosine = dr.dot(direction, hit.normal)
    reflectance = compute_pane_reflectance(cosine)
    is_first = (path.panes == 0) & (path.depth == 0)
    chance = dr.select(is_first, FIRST_MIRRORED, reflectance)
    reflected = dr.select(is_first, path.at_pane, path.random.next_float32()) < chance
    passed = GLASS_TRANSMITTANCE * (1.0 - reflectance) / (1.0 - chance)
    mirror = direction - 2.0 * cosine * hit.normal
    return replace(
        path,
        origin=mi.Point3f(hit.position + away * dr.select(reflected, hit.normal, direction)),
        direction=mi.Vector3f(dr.select(reflected, mirror, direction)),
        radiance=path.radiance + path.throughput * shine,
        throughput=path.throughput * dr.select(reflected, reflectance / chance, passed),
        panes=path.panes + 1,
    )


def _show_room(camera: Camera, path: _Path, hit: Hit) -> Hit:
    """Show rooms behind panes in view of the camera; later hits see their means."""
    pixel_m = compute_pixel_angle(camera) * path.crossing.distance

    def show(hit: Hit) -> Hit:
        return apply_room(hit, path.direction, pixel_m)

    def leave(hit: Hit) -> Hit:
        return hit

    return dr.if_stmt((hit,), (path.depth == 0) & is_room(hit.kind), show, leave)


def _build_path_surface(scene: Scene, camera: Camera, path: _Path, hit: Hit) -> Surface:
    angle = compute_pixel_angle(camera)

    def build_first(path: _Path, hit: Hit) -> Surface:
        distance = path.crossing.distance
        return build_first_surface(scene, hit, path.direction, distance, angle, path.active)

    def build_next(_: _Path, hit: Hit) -> Surface:
        return build_next_surface(scene, hit)

    s = dr.if_stmt((path, hit), path.depth == 0, build_first, build_next)
    # After a diffuse bounce mirrors would only add bright single pixels.
    return replace(s, alpha=dr.select(path.mirrored, s.alpha, dr.maximum(s.alpha, 0.5)))


def _reflect(scene: Scene, camera: Camera, path: _Path, hit: Hit, path_depth: Any) -> _Path:
    """Add the light sent back by a surface, and draw the path's next direction."""
    light, away, random = scene.light, _offset(path), path.random
    hit = _show_room(camera, path, hit)
    s = _build_path_surface(scene, camera, path, hit)
    eye = -path.direction
    emitted = dr.select(path.sees_lenses, hit.emission * hit.albedo, 0.0)
    is_direct = (path.depth == 0) & (path.panes == 0)
    found = dr.select(is_direct, 0.0, emitted)
    # Thin surfaces have the normal of a crown or a field, maybe along or behind them: an offset
    # towards the sun stays on their lit side.
    shown = dr.select(hit.is_thin, light.sun_direction, hit.normal) if light.has_sun else hit.normal
    outside = hit.position + away * shown
    found += _compute_sunlight(scene, s, eye, outside, path.active)
    travelled = path.travelled + path.crossing.distance
    if light.night and scene.lamps is not None:
        # Slightly deflected light still arrives; for the camera, from around its source.
        narrow = LOBES.narrow_fraction * light.extinction * travelled
        kept = dr.exp(dr.minimum(narrow, UNDEFLECTED_DEPTH_LIMIT))
        if light.deflects:
            kept = dr.select(path.depth == 0, 1.0, kept)
        lit, random = _compute_lamplight(
            scene, _without_mirror(s), eye, outside, random, path.active
        )
        found += kept * lit
    direction, factor, mirrored = sample_bounce(s, path.direction, random)
    throughput, depth = path.throughput * factor, path.depth + 1
    is_mirror = s.alpha < MIRROR_ALPHA if light.night else mi.Bool(True)
    return replace(
        path,
        origin=mi.Point3f(hit.position + away * dr.select(hit.is_thin, direction, hit.normal)),
        direction=mi.Vector3f(direction),
        radiance=path.radiance + path.throughput * found,
        lenses=path.lenses + dr.select(is_direct, path.throughput * emitted, 0.0),
        throughput=throughput,
        depth=depth,
        mirrored=mirrored,
        sees_lenses=mirrored & is_mirror,
        travelled=travelled,
        random=random,
        active=path.active & (depth <= path_depth) & (dr.sum(throughput) > LEAST_THROUGHPUT),
    )


def _advance(scene: Scene, path: _Path) -> _Path:
    """Find the path's next hit; hidden actors are hidden from camera rays alone."""
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
