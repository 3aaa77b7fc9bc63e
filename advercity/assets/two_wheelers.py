"""Builds bicycles and motorcycles with their riders.

Bicycles are rigged: pedals, legs and wheels move. Motorcycles are rigid but for their wheels.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache

import numpy as np
from advercity_dsl import PedestrianAppearance
from advercity_dsl.catalogue import Saddle

from advercity.assets.riders import Rider, Seat, build_rider, compute_riding_postures
from advercity.assets.rigged_bodies import POSES_PER_CYCLE, attach_to_bone, build_rigged_body
from advercity.assets.skeleton import BONE_SIDES, compute_bone_transforms
from advercity.assets.vehicle_parts import (
    SPOKE_COUNT,
    build_round_tyre,
    build_spokes,
    compute_rolling_transforms,
    make_vehicle_parts,
)
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    Size,
    TriangleSurface,
    Wheel,
    add_mirror_image,
    build_meshes,
    xyz,
)
from advercity.geometry.primitives import box, ellipsoid, loft_rings, revolve_closed_profile, tube
from advercity.materials import ACTOR_PAINT
from advercity.semantics import Semantic
from advercity.world import Body, Gait

_GEAR_RATIO = 2.5
"""Turns of the wheels in one turn of the cranks."""
# Poses repeat after a turn of the cranks, so wheels must look the same after it.
assert (_GEAR_RATIO * SPOKE_COUNT).is_integer()
_CRANK_M = 0.165
_FIN_COUNT = 6
_SPORT_LEAN_DEG = 15.0
"""Riders of model motorcycles who lean less are dressed as on a scooter."""


class BicycleBone(IntEnum):
    """Bones of a bicycle, numbered after its rider's."""

    FRAME = len(BONE_SIDES)
    CRANKS = FRAME + 1
    LEFT_PEDAL = FRAME + 2
    RIGHT_PEDAL = FRAME + 3
    FRONT_WHEEL = FRAME + 4
    REAR_WHEEL = FRAME + 5


_BONE_COUNT = len(BONE_SIDES) + len(BicycleBone)


def build_bicycle(blueprint_id: str, size: Size) -> Body:
    """Build a cyclist on a bicycle of about `size`, x forward; short bicycles are sporty."""
    frame = _BicycleGeometry(size)
    rider = Rider.from_seat(frame.seat)
    turns = np.arange(POSES_PER_CYCLE) / POSES_PER_CYCLE
    postures = compute_riding_postures(rider, frame.compute_soles(turns))
    rest = compute_riding_postures(rider, frame.compute_soles(np.zeros(1)))[0]
    sporty = frame.is_sporty
    looks = PedestrianAppearance(
        stout=0.95,
        bottom="shorts" if sporty else "trousers",
        bottom_colour="black" if sporty else "denim",
        hair="short",
        bag="none" if sporty else "backpack",
    )
    helmet = "cloth_white" if sporty else "cloth_red"
    limbs = build_rider(rest, rider.build, looks, helmet, key=blueprint_id)
    no_machine = ((0, 0), (0, len(BicycleBone)))
    limbs = [replace(limb, weights=np.pad(limb.weights, no_machine)) for limb in limbs]
    limbs += [
        attach_to_bone(surface, bone, _BONE_COUNT, material, Semantic.VEHICLE)
        for surface, bone, material in frame.generate_surfaces()
    ]
    bones = [compute_bone_transforms(rest, postures), frame.compute_bone_transforms()]
    transforms = np.concatenate(bones, axis=1).astype(np.float32)
    cycle_m = _GEAR_RATIO * 2 * np.pi * frame.radius
    return build_rigged_body(limbs, Gait(cycle_m, transforms, returns_to_rest=False), size)


def build_parked_bicycle(size: Size, paint: str) -> list[MeshPart]:
    """Build a bicycle without a rider or lamps, x forward, upright; `size` includes a rider.

    It has few materials, since a world has a mesh for each.
    """
    materials = {
        ACTOR_PAINT: paint,
        "black_plastic": "rubber",
        "rubber": "rubber",
        "metal": "metal",
    }
    return [
        MeshPart(surface, materials[material], Semantic.VEHICLE)
        for surface, material in _build_machine(size)
        if material in materials
    ]


@cache
def _build_machine(size: Size) -> tuple[tuple[TriangleSurface, str], ...]:
    """Build the surfaces of a bicycle with their materials; a street has many of one size."""
    machine = _BicycleGeometry(size).generate_surfaces()
    return tuple((surface, material) for surface, _, material in machine)


@dataclass(frozen=True)
class _BicycleGeometry:
    """Measures of a bicycle of a size, in metres in its body frame."""

    size: Size

    @property
    def is_sporty(self) -> bool:
        return self.size[0] < 1.8

    @property
    def radius(self) -> float:
        return min(0.34, 0.215 * self.size[0])

    @property
    def rear(self) -> Float64Array:
        return xyz(self.radius - self.size[0] / 2, z=self.radius)

    @property
    def front(self) -> Float64Array:
        return xyz(self.size[0] / 2 - self.radius, z=self.radius)

    @property
    def saddle(self) -> Float64Array:
        return xyz(-0.14 * self.size[0], z=0.525 * self.size[2])

    @property
    def crank(self) -> Float64Array:
        return xyz(-0.035 * self.size[0], z=0.28)

    @property
    def head(self) -> Float64Array:
        """Top of the head tube."""
        return xyz(self.front[0] - 0.13 * self.size[0], z=0.53 * self.size[2])

    @property
    def grip(self) -> Float64Array:
        x = self.head[0] - (0.0 if self.is_sporty else 0.24)
        return xyz(x, self.size[1] / 2 - 0.06, self.head[2] + 0.11)

    @property
    def seat(self) -> Seat:
        lean = np.radians(27.0 if self.is_sporty else 8.0)
        return Seat(self.saddle + xyz(0.01, 0, 0.12), self.grip, self.size[2], lean)

    def compute_pedals(self, turns: Float64Array) -> Float64Array:
        """Compute the centres (n, 2, 3) of the left and right pedal after crank turns (n,)."""
        angle = 2 * np.pi * turns[:, None] + np.array([0.0, np.pi])
        x, z = _CRANK_M * np.cos(angle), -_CRANK_M * np.sin(angle)
        y = np.broadcast_to([0.11, -0.11], angle.shape)
        return self.crank + np.stack([x, y, z], axis=-1)

    def compute_soles(self, turns: Float64Array) -> Float64Array:
        return self.compute_pedals(turns) + xyz(z=0.012)

    def compute_bone_transforms(self) -> Float64Array:
        """Compute transforms (poses, bicycle bones, 3, 4) from the rest pose to every pose."""
        turns = np.arange(POSES_PER_CYCLE) / POSES_PER_CYCLE
        still = np.broadcast_to(np.eye(3, 4), (POSES_PER_CYCLE, 3, 4))
        pedals = self.compute_pedals(turns) - self.compute_pedals(np.zeros(1))
        transforms = np.stack([still] * len(BicycleBone), axis=1)
        first = BicycleBone.FRAME
        transforms[:, BicycleBone.LEFT_PEDAL - first, :, 3] = pedals[:, 0]
        transforms[:, BicycleBone.RIGHT_PEDAL - first, :, 3] = pedals[:, 1]
        for bone, hub, ratio in (
            (BicycleBone.CRANKS, self.crank, 1.0),
            (BicycleBone.FRONT_WHEEL, self.front, _GEAR_RATIO),
            (BicycleBone.REAR_WHEEL, self.rear, _GEAR_RATIO),
        ):
            transforms[:, bone - first] = compute_rolling_transforms(hub, ratio * turns)
        return transforms

    def generate_surfaces(self) -> Iterator[tuple[TriangleSurface, int, str]]:
        """Generate the surfaces of the machine with their bones and materials."""
        for surface in self._build_tubes():
            yield surface, BicycleBone.FRAME, ACTOR_PAINT
        for surface in self._build_fittings():
            yield surface, BicycleBone.FRAME, "black_plastic"
        lamp, tail = self.head + xyz(0.05, 0, 0.02), self.saddle + xyz(-0.07, 0, -0.12)
        ball = (0.03, 0.03, 0.03)
        yield ellipsoid(lamp, ball, sides=8, bands=4), BicycleBone.FRAME, "lamp_white"
        yield ellipsoid(tail, ball, sides=8, bands=4), BicycleBone.FRAME, "lamp_red"
        yield from self._build_drive()
        wheels = (self.front, BicycleBone.FRONT_WHEEL), (self.rear, BicycleBone.REAR_WHEEL)
        for hub, bone in wheels:
            yield build_round_tyre(hub, self.radius, 0.022), bone, "rubber"
            for surface in build_spokes(hub, self.radius):
                yield surface, bone, "metal"

    def _build_tubes(self) -> list[TriangleSurface]:
        low, head, crank = self.head - xyz(-0.02, 0, 0.10), self.head, self.crank
        post = crank + 0.86 * (self.saddle - crank)
        top = post if self.is_sporty else crank + 0.45 * (self.saddle - crank)
        stays = [
            add_mirror_image(
                tube([end + xyz(0, 0.02, 0), self.rear + xyz(0, 0.055, 0)], 0.011, sides=5)
            )
            for end in (crank, post)
        ]
        fork = add_mirror_image(
            tube([low + xyz(0.01, 0.03, 0), self.front + xyz(0, 0.055, 0)], 0.014, sides=5)
        )
        return [
            tube([crank, post], 0.02),
            tube([crank, low], 0.024),
            tube([top, 0.4 * low + 0.6 * head], 0.022),
            tube([low, head], 0.024),
            *stays,
            fork,
        ]

    def _build_fittings(self) -> list[TriangleSurface]:
        stem = self.head + xyz(-0.01, 0, 0.10)
        half = self.grip + xyz(-0.07, 0.04, -0.01)
        bend = stem + xyz(0.02, 0.5 * self.grip[1], 0.01)
        mirror = np.array([1, -1, 1])
        bars = [half * mirror, self.grip * mirror, bend * mirror, stem, bend, self.grip, half]
        return [
            tube(bars, 0.015, sides=6),
            tube([self.head, stem], 0.016, sides=6),
            tube([self.crank + 0.84 * (self.saddle - self.crank), self.saddle], 0.014, sides=6),
            ellipsoid(self.saddle + xyz(0, 0, 0.03), (0.14, 0.08, 0.035), sides=8, bands=4),
        ]

    def _build_drive(self) -> Iterator[tuple[TriangleSurface, int, str]]:
        wheel = [self.crank - xyz(0, 0.06, 0), self.crank - xyz(0, 0.045, 0)]
        yield tube(wheel, 0.09, sides=12), BicycleBone.CRANKS, "metal"
        pedals = self.compute_pedals(np.zeros(1))[0]
        bones = (BicycleBone.LEFT_PEDAL, BicycleBone.RIGHT_PEDAL)
        for pedal, bone in zip(pedals, bones, strict=True):
            inner = np.sign(pedal[1]) * xyz(y=0.065)
            arm = tube([self.crank + inner, pedal * (1, 0, 1) + inner], 0.012, sides=5)
            yield arm, BicycleBone.CRANKS, "metal"
            edge = xyz(0.05, 0.042, 0.012)
            yield box(pedal - edge, pedal + edge), bone, "black_plastic"


def build_motorcycle(blueprint_id: str, size: Size) -> Body:
    """Build a rider on a motorcycle of about `size`, or on a scooter if it is short."""
    length, width, height = size
    scooter = length < 1.95
    cruiser = length > 2.25
    radius = 0.24 if scooter else 0.31
    rear, front = xyz(radius - length / 2, z=radius), xyz(length / 2 - radius, z=radius)
    saddle = xyz(-0.14 * length, z=0.47 * height)
    head = xyz(front[0] - (0.30 if cruiser else 0.20), z=0.60 * height)
    grip = head + xyz(-0.14 if cruiser else -0.08, width / 2 - 0.05, 0.10 if cruiser else 0.02)
    bars = [grip * (1, -1, 1) - (0.08, 0.04, 0), head, grip + xyz(-0.08, 0.04, 0)]
    if scooter:
        shell = _build_scooter_shell(front, saddle, head)
    else:
        fairing = [] if cruiser else [_build_fairing(saddle, head)]
        shell = [*_build_motorcycle_shell(rear, saddle, head), *fairing]
    fork = add_mirror_image(tube([front + xyz(0, 0.08, 0), head + xyz(0, 0.08, 0)], 0.028, sides=6))
    seat = ellipsoid(saddle + xyz(-0.08, 0, 0.03), (0.30, 0.13, 0.065), sides=10, bands=5)
    fenders = [_build_fender(hub, radius) for hub in (front, rear)]
    lamp = head + xyz(0.07, 0, -0.04)
    tail = xyz(rear[0] - 0.05, z=0.52 if scooter else saddle[2] + 0.02)
    headlamp = ellipsoid(lamp, (0.06, 0.085, 0.085), sides=10, bands=5)
    tail_lamp = ellipsoid(tail, (0.05, 0.07, 0.04), sides=8, bands=4)
    foot = xyz(0.12 * length if scooter or cruiser else -0.08 * length, z=0.30)
    lean = np.radians(3.0 if scooter or cruiser else 24.0)
    place = Seat(saddle + xyz(0, 0, 0.15), grip, height, lean)
    parts = [
        *make_vehicle_parts(ACTOR_PAINT, *shell, *fenders),
        *make_vehicle_parts("black_plastic", tube(bars, 0.02, sides=6), seat),
        *make_vehicle_parts("metal", fork, *([] if scooter else _build_engine(rear, length))),
        *(_build_cruiser_trim(rear, head, length) if cruiser else _build_exhaust(rear)),
        *_build_mirrors(grip),
        *make_vehicle_parts("lamp_white", headlamp),
        *make_vehicle_parts("lamp_red", tail_lamp),
        *_build_motorcycle_wheel(front, radius),
        *_build_motorcycle_wheel(rear, radius),
        *_build_motorcyclist(blueprint_id, place, foot + xyz(y=0.19), scooter=scooter),
    ]
    return Body(tuple(build_meshes(parts)), size)


def build_model_rider(blueprint_id: str, saddle: Saddle, size: Size) -> list[MeshPart]:
    """Build a rider for the model of a motorcycle, from its declared saddle, grip and peg."""
    pelvis = xyz(*saddle.seat) + xyz(z=0.12)
    place = Seat(pelvis, xyz(*saddle.grip), size[2], np.radians(saddle.lean_deg))
    scooter = saddle.lean_deg < _SPORT_LEAN_DEG
    return _build_motorcyclist(blueprint_id, place, xyz(*saddle.peg), scooter=scooter)


def _build_motorcyclist(
    blueprint_id: str, seat: Seat, peg: Float64Array, *, scooter: bool
) -> list[MeshPart]:
    rider = Rider.from_seat(seat)
    looks = PedestrianAppearance(stout=1.05, bottom_colour="denim" if scooter else "black")
    helmet = "car_paint_white" if scooter else "black_plastic"
    posture = compute_riding_postures(rider, np.array([[peg, peg * (1, -1, 1)]]))[0]
    limbs = build_rider(posture, rider.build, looks, helmet, key=blueprint_id, has_visor=True)
    return [MeshPart(limb.surface, limb.material, limb.semantic) for limb in limbs]


def _build_motorcycle_wheel(hub: Float64Array, radius: float) -> list[MeshPart]:
    wheel = Wheel(tuple(hub.tolist()))
    inner, half = 0.66 * radius, 0.035
    outer = inner + 0.03
    ring = [(inner, -half), (outer, -half), (outer, half), (inner, half)]
    rim = revolve_closed_profile(ring, hub, sides=14)
    tyre, spokes = build_round_tyre(hub, radius, 0.065), build_spokes(hub, 0.72 * radius)
    return [
        *make_vehicle_parts("rubber", tyre, wheel=wheel),
        *make_vehicle_parts("metal", rim, *spokes, wheel=wheel),
    ]


def _build_fender(hub: Float64Array, radius: float) -> TriangleSurface:
    angle = np.radians(np.linspace(35, 150, 7))
    outer, half = radius + 0.035, 0.075
    arc = np.column_stack([np.cos(angle), np.zeros(7), np.sin(angle)])
    side, inner = np.array([0.0, half, 0.0]), outer - 0.02
    rings = [
        hub + np.array([a * outer - side, a * outer + side, a * inner + side, a * inner - side])
        for a in arc
    ]
    return loft_rings(np.stack(rings))


def _build_hull(stations: list[tuple[float, float, float, float]]) -> TriangleSurface:
    """Loft a hull over elliptical sections: (x, z of the centre, half width, half height)."""
    angle = 2 * np.pi * np.arange(10) / 10
    rings = [
        np.column_stack([np.full(10, x), half_y * np.cos(angle), z + half_z * np.sin(angle)])
        for x, z, half_y, half_z in stations
    ]
    return loft_rings(np.stack(rings))


def _build_motorcycle_shell(
    rear: Float64Array, saddle: Float64Array, head: Float64Array
) -> list[TriangleSurface]:
    x0, x1, z = saddle[0], head[0], saddle[2]
    tank = [(x0 + 0.05, z + 0.0, 0.08, 0.05), (x0 + 0.16, z + 0.06, 0.14, 0.11)]
    tank += [(x1 - 0.14, z + 0.08, 0.15, 0.13), (x1 - 0.02, z + 0.04, 0.09, 0.08)]
    tail = [(rear[0] - 0.10, z + 0.05, 0.04, 0.03), (rear[0] + 0.05, z + 0.0, 0.09, 0.06)]
    tail += [(x0, z - 0.06, 0.12, 0.08)]
    return [_build_hull(tank), _build_hull(tail)]


def _build_fairing(saddle: Float64Array, head: Float64Array) -> TriangleSurface:
    x, z = head[0], saddle[2]
    stations = [(x - 0.30, z - 0.28, 0.13, 0.12), (x - 0.08, z - 0.14, 0.18, 0.24)]
    stations += [(x + 0.10, z + 0.02, 0.16, 0.16), (x + 0.17, z + 0.06, 0.07, 0.08)]
    return _build_hull(stations)


def _build_cruiser_trim(rear: Float64Array, head: Float64Array, length: float) -> list[MeshPart]:
    """Build the down tubes of the frame, and two long exhausts on the right."""
    foot = xyz(0.08 * length, 0.08, 0.32)
    frame = add_mirror_image(tube([head + xyz(-0.03, 0.03, -0.1), foot], 0.022, sides=6))
    bends = [(0.2, -0.14, 0.6), (0.3, -0.17, 0.36), (-0.1, -0.18, 0.27)]
    exhausts = [
        tube(
            [*np.array(bends) + xyz(-shift, z=lift), rear + xyz(-0.1, -0.18, lift)], radii, sides=6
        )
        for shift, lift, radii in ((0.0, 0.0, (0.03, 0.03, 0.04, 0.05)), (0.3, 0.11, 0.04))
    ]
    return [
        *make_vehicle_parts("black_plastic", frame),
        *make_vehicle_parts("chrome", *exhausts),
    ]


def _build_exhaust(rear: Float64Array) -> list[MeshPart]:
    pipe = [xyz(0.1, z=0.24), xyz(-0.2, z=0.22), rear + xyz(-0.10, 0, 0.03)]
    exhaust = tube(np.array(pipe) + xyz(0, -0.16, 0), [0.03, 0.035, 0.05], sides=8)
    return make_vehicle_parts("metal", exhaust)


def _build_mirrors(grip: Float64Array) -> list[MeshPart]:
    middle = grip + xyz(0.05, -0.06, 0.16)
    stem = tube([grip + xyz(0.03, -0.1, 0.0), middle], 0.008, sides=4)
    mirror = ellipsoid(middle, (0.015, 0.055, 0.045), sides=6, bands=3)
    return make_vehicle_parts("black_plastic", *map(add_mirror_image, (stem, mirror)))


def _build_scooter_shell(
    front: Float64Array, saddle: Float64Array, head: Float64Array
) -> list[TriangleSurface]:
    x0, z = saddle[0], saddle[2]
    shield_foot = xyz(front[0] - 0.34, z=0.30)
    rear = [(x0 - 0.42, 0.48, 0.06, 0.08), (x0 - 0.25, 0.48, 0.17, 0.20), (x0, 0.50, 0.18, 0.20)]
    rear += [(x0 + 0.20, z - 0.16, 0.12, 0.16)]
    floor = box((x0, -0.17, 0.26), (shield_foot[0], 0.17, 0.32))
    sections = ((shield_foot, 0, 0.16), ((shield_foot + head) / 2, 0.03, 0.21), (head, 0, 0.12))
    rings: list[list[tuple[float, float, float]]] = []
    for place, shift, half in sections:
        x, up = place[0] + shift, place[2]
        rings.append([(x, half, up), (x + 0.03, 0, up), (x, -half, up), (x - 0.05, 0, up)])
    shield = loft_rings(rings)
    return [_build_hull(rear), floor, shield]


def _build_engine(rear: Float64Array, length: float) -> list[TriangleSurface]:
    half = 0.08 * length
    crankcase = box((-half - 0.02, -0.15, 0.22), (half + 0.02, 0.15, 0.42))
    cylinders = [
        _build_finned_cylinder(xyz(0.0, z=0.38), xyz(0.26 * lean, z=0.66)) for lean in (-0.55, 0.75)
    ]
    arm = add_mirror_image(tube([xyz(-0.05, 0.09, 0.36), rear + xyz(y=0.09)], 0.03, sides=4))
    return [crankcase, *cylinders, arm]


def _build_finned_cylinder(foot: Float64Array, head: Float64Array) -> TriangleSurface:
    """Build a cylinder with cooling fins, square as on most motorcycles."""
    place = np.linspace(0.0, 1.0, 4 * _FIN_COUNT)
    is_fin = np.arange(4 * _FIN_COUNT) % 4 < 2
    return tube(foot + place[:, None] * (head - foot), np.where(is_fin, 0.14, 0.115), sides=4)
