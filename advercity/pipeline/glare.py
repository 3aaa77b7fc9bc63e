"""Finds unobstructed sun positions in the view of the ego's camera by casting rays.

The compiler has no world to cast rays into, so the positions are written into the weather's
`sun_at`, from where specs take them.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from advercity_dsl import Spec, Suite, Weather
from advercity_dsl.weather_components import Sun
from numpy.typing import NDArray

from advercity.compiler import Library, LibraryEntry, compile_suite
from advercity.compiler.authoring import write_sun_positions
from advercity.diagnostics import DiagnosticsError
from advercity.errors import InputError
from advercity.geometry.arrays import Float64Array
from advercity.physics.sky import direction_from_elevation_azimuth
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.camera_model import CameraModel

FRAME_STRIDE = 5
"""Step from one checked frame to the next."""
ELEVATIONS_DEG = np.arange(5.0, 46.0)
"""Searched elevations; the air dims lower suns too much to blind."""
AZIMUTHS_DEG = np.arange(360.0)
SUN_RAY_LENGTH_M = 2000.0


@dataclass(frozen=True)
class SunSolution:
    """A sun position and how the ego's front camera sees it.

    Attributes:
        elevation_deg: Above the horizon.
        azimuth_deg: Clockwise from north.
        visible_fraction: Fraction of the ego's frames in which it is in view.
        off_axis_deg: Mean angle from the camera's axis in those frames.
    """

    elevation_deg: float
    azimuth_deg: float
    visible_fraction: float
    off_axis_deg: float


@dataclass(frozen=True)
class SunRequest:
    """A weather's request for a sun in the ego's view at a road.

    Attributes:
        weather: The weather.
        spec: A scenario of the road; the ego's route is the same in all of them.
    """

    weather: LibraryEntry[Weather]
    spec: Spec

    @property
    def constraint(self) -> Sun:
        """Constraint on the sun."""
        return self.weather.declaration.sun

    @property
    def known_position(self) -> Sun | None:
        """Position found earlier, or written by hand, if any."""
        sun = self.weather.declaration.sun_at.get(self.spec.road.id)
        return None if sun is None or sun.in_view_of is not None else sun

    def __str__(self) -> str:
        """Name weather and road."""
        return f"{self.spec.weather.id} at {self.spec.road.id}"


def find_sun_requests(library: Library, suite: Suite) -> list[SunRequest]:
    """Find the suns requested by weathers of a suite, once per road, with the least traffic."""
    found: dict[str, SunRequest] = {}
    # Without models, so the suns do not depend on installed packages.
    shaped = suite.model_copy(update={"looks": "shaped"})
    specs = compile_suite(library, shaped, require_sun=False)
    for spec in sorted(specs, key=lambda spec: spec.demand.vehicles):
        weather = library.find_entry(library.get_declarations(Weather)[spec.weather.id])
        if weather.declaration.sun.in_view_of is not None:
            sought = SunRequest(weather, spec)
            found.setdefault(str(sought), sought)
    return list(found.values())


def solve_sun(spec: Spec, sought: Sun) -> SunSolution:
    """Find the sun visible long enough and nearest to the axis of the ego's front camera.

    Args:
        spec: A scenario of the road; its weather does not matter.
        sought: Largest angle off the axis, and smallest fraction of the ego's frames.

    Raises:
        InputError: No sun meets the constraint.
    """
    elevation, azimuth = (
        grid.ravel() for grid in np.meshgrid(ELEVATIONS_DEG, AZIMUTHS_DEG, indexing="ij")
    )
    suns = np.stack(
        [direction_from_elevation_azimuth(*place) for place in zip(elevation, azimuth, strict=True)]
    )
    if not spec.ego.sensors.cameras:
        raise InputError(f"{spec.road.id}: the ego has no camera, which the sun is to shine into")
    off, seen = _compute_visibility(spec, suns, math.radians(sought.within_deg))
    fraction = seen.mean(axis=0)
    best = int(fraction.argmax())
    if fraction[best] < sought.seen_share:
        raise InputError(
            f"{spec.road.id}: no sun is within {sought.within_deg:g} deg of the axis of the ego's"
            f" camera for {sought.seen_share:.0%} of its route; one at elevation"
            f" {elevation[best]:g}, azimuth {azimuth[best]:g} is for {fraction[best]:.0%};"
            " allow more (within_deg), or ask for less (seen_share)"
        )
    mean_off = (off * seen).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    best = int(np.where(fraction >= sought.seen_share, mean_off, np.inf).argmin())
    return SunSolution(
        float(elevation[best]),
        float(azimuth[best]),
        float(fraction[best]),
        math.degrees(mean_off[best]),
    )


def compute_visible_fraction(spec: Spec, sun: Sun, within_deg: float) -> float:
    """Compute the fraction of the ego's frames with an unobstructed sun near the camera's axis."""
    direction = direction_from_elevation_azimuth(sun.elevation_deg, sun.azimuth_deg)
    return float(_compute_visibility(spec, direction[None], math.radians(within_deg))[1].mean())


def _compute_visibility(
    spec: Spec, suns: Float64Array, within_rad: float
) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Compute angles (frames, suns) off the axis, and whether each sun is seen unobstructed."""
    traffic = load_or_simulate_traffic(spec)
    raycaster = Raycaster(load_or_build_world(spec, traffic.network_path))
    poses = AgentPoses(spec, traffic.trace)
    camera = spec.ego.sensors.cameras[0].model
    size = camera.width_px, camera.height_px
    model = CameraModel.build(camera, *size)
    offs: list[Float64Array] = []
    views: list[NDArray[np.bool_]] = []
    for index in range(0, len(traffic.trace), FRAME_STRIDE):
        frame = poses.load_frame(index)
        front = poses.world_from_sensors("camera", spec.ego, frame)[0]
        directions = suns @ front[:3, :3]
        pixels = model.pixels_from_camera(directions)
        off = np.arccos(np.clip(directions[:, 0], -1.0, 1.0))
        inside = (directions[:, 0] > 0) & ((pixels > 0) & (pixels < size)).all(axis=1)
        seen = (off <= within_rad) & inside
        raycaster.place(frame, hide=frozenset({spec.ego.number}))
        rows = np.flatnonzero(seen)
        eyes = np.broadcast_to(front[:3, 3], (len(rows), 3)).astype(np.float32)
        rays = Rays(np.ascontiguousarray(eyes), suns[rows].astype(np.float32))
        seen[rows] = np.isinf(raycaster.cast(rays, SUN_RAY_LENGTH_M).range_m)
        offs.append(off)
        views.append(seen)
    return np.stack(offs), np.stack(views)


def solve_suns(library: Library, suite: Suite) -> Iterator[str]:
    """Find and write the missing suns of weathers; yield a line on each.

    Existing suns, found before or written by hand, are checked and stay.

    Raises:
        InputError: No sun meets a constraint, an existing one does not, or a weather's file cannot
            be written.
    """
    requests = find_sun_requests(library, suite)
    for known in requests:
        if known.known_position is not None:
            yield _check_sun(known, known.known_position)
    by_file: dict[Path, dict[str, Sun]] = {}
    for sought in requests:
        if sought.known_position is not None:
            continue
        found = solve_sun(sought.spec, sought.constraint)
        sun = Sun(elevation_deg=found.elevation_deg, azimuth_deg=found.azimuth_deg)
        path = sought.weather.source.find_document(("sun", "in_view_of")).path
        by_file.setdefault(path, {})[sought.spec.road.id] = sun
        yield (
            f"{sought}: elevation {found.elevation_deg:g}, azimuth "
            f"{found.azimuth_deg:g}, in view on {found.visible_fraction:.0%} of the route, "
            f"{found.off_axis_deg:.1f} deg off the axis"
        )
    for path, suns in by_file.items():
        write_sun_positions(path, suns)


def check_suns(library: Library, suite: Suite) -> Iterator[str]:
    """Check the suns found before against their constraints; yield a line on each.

    Raises:
        InputError: A sun is not in view for long enough, or was never found.
    """
    for sought in find_sun_requests(library, suite):
        if sought.known_position is None:
            raise InputError(f"{sought}: no sun was found yet; run `advercity solve`")
        yield _check_sun(sought, sought.known_position)


def _check_sun(sought: SunRequest, sun: Sun) -> str:
    """Describe an existing sun; InputError if it is not in view for long enough."""
    wanted = sought.constraint
    fraction = compute_visible_fraction(sought.spec, sun, wanted.within_deg)
    line = f"{sought}: in view on {fraction:.0%} of the route"
    if fraction >= wanted.seen_share:
        return line
    message = f"{sought}: in view on {fraction:.1%} of the route, not {wanted.seen_share:.1%}"
    hint = "delete this sun, and `advercity solve` finds another"
    place = ("sun_at", sought.spec.road.id)
    raise DiagnosticsError(
        sought.weather.source.build_diagnostic(place, message, hint=hint, key=True)
    )
