"""Finds the sun that an ego drives into, and proves by rays that nothing hides it for long.

The compiler has no world to cast rays into, so what is found here is written into the weather's
`sun_at`, from where specs take it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from advercity_dsl import Spec, Suite, Weather
from advercity_dsl.weather import Sun
from numpy.typing import NDArray

from advercity.compiler import Library, LibraryEntry, compile_suite
from advercity.compiler.authoring import write_sun_positions
from advercity.errors import InputError
from advercity.geometry.arrays import Float64Array
from advercity.physics.sky import direction_from_elevation_azimuth
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.rendering.raycaster import Raycaster, Rays

FRAME_STRIDE = 5
"""Kept frames from one that is looked from to the next."""
ELEVATIONS_DEG = np.arange(5.0, 46.0)
"""Where suns are looked for; lower ones are behind so much air that they hardly blind."""
AZIMUTHS_DEG = np.arange(360.0)
SUN_RAY_LENGTH_M = 2000.0


@dataclass(frozen=True)
class SunSolution:
    """A sun and how an ego sees it.

    Attributes:
        elevation_deg: Above the horizon.
        azimuth_deg: Clockwise from north.
        visible_fraction: Of the ego's frames, those in which it is in view.
        off_axis_deg: From the axis of the ego's front camera, in the mean of those.
    """

    elevation_deg: float
    azimuth_deg: float
    visible_fraction: float
    off_axis_deg: float


@dataclass(frozen=True)
class SunRequest:
    """A sun that a weather wants in an ego's view at a road.

    Attributes:
        weather: Where it says so.
        spec: A scenario of the road; in the others the ego goes the same way.
    """

    weather: LibraryEntry[Weather]
    spec: Spec

    @property
    def constraint(self) -> Sun:
        """How it is wanted."""
        return self.weather.declaration.sun

    @property
    def known_position(self) -> Sun | None:
        """What was found before."""
        return self.weather.declaration.sun_at.get(self.spec.road.id)

    def __str__(self) -> str:
        """Weather and road."""
        return f"{self.spec.weather.id} at {self.spec.road.id}"


def find_sun_requests(library: Library, suite: Suite) -> list[SunRequest]:
    """All suns that weathers of a suite want in view, once for each road, where traffic is thin."""
    found: dict[str, SunRequest] = {}
    specs = compile_suite(library, suite, require_sun=False)
    for spec in sorted(specs, key=lambda spec: spec.demand.vehicles):
        weather = library.find_entry(library.get_declarations(Weather)[spec.weather.id])
        if weather.declaration.sun.in_view_of is not None:
            sought = SunRequest(weather, spec)
            found.setdefault(str(sought), sought)
    return list(found.values())


def solve_sun(spec: Spec, sought: Sun) -> SunSolution:
    """The sun nearest to the axis of the ego's front camera that it sees for long enough.

    Args:
        spec: Whose road and ego are meant; its weather does not matter.
        sought: How near the axis it is to be, and for which share of the ego's frames.

    Raises:
        InputError: There is none.
    """
    elevation, azimuth = (
        grid.ravel() for grid in np.meshgrid(ELEVATIONS_DEG, AZIMUTHS_DEG, indexing="ij")
    )
    suns = np.stack(
        [direction_from_elevation_azimuth(*place) for place in zip(elevation, azimuth, strict=True)]
    )
    off, seen = _compute_visibility(spec, suns, math.radians(sought.within_deg))
    share = seen.mean(axis=0)
    best = int(share.argmax())
    if share[best] < sought.seen_share:
        raise InputError(
            f"{spec.road.id}: no sun is within {sought.within_deg:g} deg of the axis of the ego's "
            f"camera for {sought.seen_share:.0%} of its way; one at elevation {elevation[best]:g}, "
            f"azimuth {azimuth[best]:g} is for {share[best]:.0%}; allow more (within_deg), or ask "
            "for less (seen_share)"
        )
    mean_off = (off * seen).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    best = int(np.where(share >= sought.seen_share, mean_off, np.inf).argmin())
    return SunSolution(
        float(elevation[best]),
        float(azimuth[best]),
        float(share[best]),
        math.degrees(mean_off[best]),
    )


def compute_visible_fraction(spec: Spec, sun: Sun, within_deg: float) -> float:
    """Share of the ego's frames in which a sun is that near the axis of its camera, and open."""
    direction = direction_from_elevation_azimuth(sun.elevation_deg, sun.azimuth_deg)
    return float(_compute_visibility(spec, direction[None], math.radians(within_deg))[1].mean())


def _compute_visibility(
    spec: Spec, suns: Float64Array, within_rad: float
) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Angles (frames, suns) off the axis, and whether each is in view and nothing hides it."""
    stage = load_or_simulate_traffic(spec)
    caster, viewpoints = (
        Raycaster(load_or_build_world(spec, stage.network_path)),
        AgentPoses(spec, stage.trace),
    )
    camera = spec.ego.sensors.camera
    across = math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    down = across * camera.height_px / camera.width_px
    offs: list[Float64Array] = []
    views: list[NDArray[np.bool_]] = []
    for index in range(0, len(stage.trace), FRAME_STRIDE):
        front = viewpoints.world_from_cameras(spec.ego, index)[0]
        ahead, left, up = (suns @ front[:3, :3]).T
        off = np.arccos(np.clip(ahead, -1.0, 1.0))
        seen = (off <= within_rad) & (abs(left) < across * ahead) & (abs(up) < down * ahead)
        caster.place(viewpoints.load_frame(index), hide=frozenset({spec.ego.number}))
        rows = np.flatnonzero(seen)
        eyes = np.broadcast_to(front[:3, 3], (len(rows), 3)).astype(np.float32)
        rays = Rays(np.ascontiguousarray(eyes), suns[rows].astype(np.float32))
        seen[rows] = np.isinf(caster.cast(rays, SUN_RAY_LENGTH_M).range_m)
        offs.append(off)
        views.append(seen)
    return np.stack(offs), np.stack(views)


def solve_suns(library: Library, suite: Suite) -> Iterator[str]:
    """Find all suns that are sought and write them into their weathers; a line on each.

    Raises:
        InputError: There is no such sun, or a weather's file cannot be written.
    """
    by_file: dict[Path, dict[str, Sun]] = {}
    for sought in find_sun_requests(library, suite):
        found, road = solve_sun(sought.spec, sought.constraint), sought.spec.road.id
        sun = Sun(elevation_deg=found.elevation_deg, azimuth_deg=found.azimuth_deg)
        path = sought.weather.source.find_document(("sun", "in_view_of")).path
        by_file.setdefault(path, dict(sought.weather.declaration.sun_at))[road] = sun
        yield (
            f"{sought}: elevation {found.elevation_deg:g}, azimuth "
            f"{found.azimuth_deg:g}, in view on {found.visible_fraction:.0%} of the way, "
            f"{found.off_axis_deg:.1f} deg off the axis"
        )
    for path, suns in by_file.items():
        write_sun_positions(path, suns)


def check_suns(library: Library, suite: Suite) -> Iterator[str]:
    """A line on each sun that was found before and is in view for as long as is asked for.

    Raises:
        InputError: One is not, or was never found.
    """
    for sought in find_sun_requests(library, suite):
        wanted = sought.constraint
        if sought.known_position is None:
            raise InputError(f"{sought}: no sun was found yet; run `advercity solve`")
        share = compute_visible_fraction(sought.spec, sought.known_position, wanted.within_deg)
        told = f"{sought}: in view on {share:.0%} of the way"
        if share < wanted.seen_share:
            raise InputError(f"{told}, not {wanted.seen_share:.0%}; run `advercity solve` again")
        yield told
