"""LiDARs, surfaces and weathers for tests."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from advercity_dsl import Lidar, Weather
from numpy.typing import NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.raycaster import MATERIAL_NAMES, Raycaster, RayHits
from advercity.semantics import Semantic
from advercity.sensors.lidar import (
    LidarConditions,
    ScanHits,
    derive_lidar_conditions,
    measure_point_cloud,
)
from advercity.sensors.lidar.received_power import Receiver, detection_margin_sigma
from advercity.sensors.measurements import PointCloud, PointKind
from advercity.world import Body, World

Array = NDArray[np.float64]


received_power = Receiver.from_lidar(Lidar()).received_power


CLEAR = {"air": {"mor_m": 20_000}}


VACUUM = {"air": {"mor_m": None}}


DARK = Lidar(sunlight_noise=False)


EXACT = Lidar(sunlight_noise=False, detection="step")


ROADSIDE = Lidar(
    sunlight_noise=False,
    range_noise_m=0.02,
    dropoff_rate=0.3,
    dropoff_intensity_limit=0.7,
    dropoff_zero_intensity=0.4,
)


def air(**parts: Any) -> LidarConditions:
    weather = Weather.model_validate({"id": "tried", "time": "day"} | CLEAR | parts)
    return derive_lidar_conditions(compute_atmosphere(weather, "rural"), weather.lens)


def vary(lidar: Lidar, **fields: Any) -> Lidar:
    return Lidar.model_validate(lidar.model_dump() | fields)


def scanned(hits: RayHits) -> ScanHits:
    return ScanHits(hits, (), np.empty(0, np.intp), None, np.eye(4), None)


def half_detection_range_m(reflected: float, extinction: float) -> float:
    """Where an echo is lost as often as found, by bisection."""
    near, far = 1.0, 1000.0
    for _ in range(60):
        middle = (near + far) / 2
        power = received_power(np.array([middle]), np.array([reflected]), extinction)
        near, far = (middle, far) if detection_margin_sigma(power)[0] > 0 else (near, middle)
    return near


def misses(count: int) -> RayHits:
    """That many rays that met nothing."""
    return RayHits(
        range_m=np.full(count, np.inf, np.float32),
        normal=np.zeros((count, 3), np.float32),
        cosine=np.zeros(count, np.float32),
        material=np.zeros(count, np.int16),
        semantic=np.zeros(count, np.uint8),
        instance=np.zeros(count, np.int32),
    )


def panel(range_m: float, lidar: Lidar = DARK, material: str = "concrete") -> RayHits:
    """Hits of a wall that faces the sensor, the same for every beam."""
    hits = misses(lidar.azimuths * lidar.channels * lidar.sub_rays)
    hits.range_m[:] = range_m
    hits.normal[:, 0] = -1
    hits.cosine[:] = 1
    hits.material[:] = MATERIAL_NAMES.index(material)
    hits.semantic[:] = Semantic.WALL
    return hits


def plate(
    name: str, corners: Sequence[tuple[float, float, float]], material: str, tag: Semantic
) -> Mesh:
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(name, np.array(corners, np.float32), triangles, material, tag)


def upright(x: float, half: float, height: float, material: str = "plaster") -> Mesh:
    corners = [(x, -half, 0), (x, half, 0), (x, half, height), (x, -half, height)]
    return plate(f"wall{x}", corners, material, Semantic.WALL)


def ground(material: str = "plaster") -> Mesh:
    corners = [(-300, -300, 0), (300, -300, 0), (300, 300, 0), (-300, 300, 0)]
    return plate("ground", corners, material, Semantic.ROAD)


TARGET = Body((upright(0, 2, 3),), (1, 4, 3))


def frame_with(*positions: tuple[float, float], speed_m_s: float = 0.0) -> Frame:
    states = tuple(
        ActorState(
            Actor(number, "van", "panel", "plaster", TARGET.size),
            pose_matrix((x, y, 0)),
            speed_m_s,
            0.0,
            Lamp(0),
        )
        for number, (x, y) in enumerate(positions, start=1)
    )
    return Frame(0, 0.0, states, {})


def raycaster_of(*static: Mesh) -> Raycaster:
    return Raycaster(World("tried", static, {"panel": TARGET}, (), Path("none")))


def raycaster_with(*positions: tuple[float, float], walls: Sequence[Mesh] = ()) -> Raycaster:
    caster = raycaster_of(ground(), *walls)
    caster.place(frame_with(*positions))
    return caster


STAND = pose_matrix((0, 0, 1.9))


def measure(lidar: Lidar, seen: RayHits | ScanHits, *key: int, **weather: Any) -> PointCloud:
    scan = scanned(seen) if isinstance(seen, RayHits) else seen
    return measure_point_cloud(lidar, scan, air(**weather), create_generator("test", *key))


def fraction_of(found: PointCloud, kind: PointKind, lidar: Lidar = EXACT) -> float:
    """Share of beams that report a point of a kind, one a beam at most."""
    return float((found.kind == kind).sum()) / (lidar.azimuths * lidar.channels)


def sky(lidar: Lidar = EXACT) -> RayHits:
    """Nothing but air."""
    return misses(lidar.azimuths * lidar.channels)


WALL_AHEAD = upright(20.0, 400.0, 60.0)


MOVING = vary(EXACT, motion_distortion=True, lower_deg=0, upper_deg=15)


FORWARD_M = 40 / 3.6 * 0.1
"""What 40 km/h is in a turn."""
