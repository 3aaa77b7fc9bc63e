"""Bicycles and those who pedal them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from advercity_dsl import Looks

from advercity.semantics import Semantic
from advercity.world.bodies.puppets import POSES, puppet, rigid
from advercity.world.bodies.riders import Rider, Seat, dressed, riding
from advercity.world.bodies.skeleton import SIDES, moves
from advercity.world.bodies.spokes import SPOKES, spokes, tyre
from advercity.world.materials import PAINT
from advercity.world.scene import Body, Gait
from advercity.world.shapes import Floats, Surface, both_sides, box, ellipsoid, tube, xyz

Size = tuple[float, float, float]
_GEAR = 2.5
"""Turns of the wheels in one of the cranks; a whole number of spokes."""
_CRANK_M = 0.165
assert (_GEAR * SPOKES).is_integer()


class Iron(IntEnum):
    """Bones of the machine, after those of its rider."""

    FRAME = len(SIDES)
    CRANKS = FRAME + 1
    LEFT_PEDAL = FRAME + 2
    RIGHT_PEDAL = FRAME + 3
    FRONT_WHEEL = FRAME + 4
    REAR_WHEEL = FRAME + 5


_BONES = len(SIDES) + len(Iron)


def bicycle(blueprint_id: str, size: Size) -> Body:
    """A cyclist on a bicycle of about `size`, x forward; short ones are for sport."""
    frame = _Frame(size)
    rider = Rider.on(frame.seat)
    postures = riding(rider, frame.soles(np.arange(POSES) / POSES))
    rest = riding(rider, frame.soles(np.zeros(1)))[0]
    sporty = frame.sporty
    looks = Looks(
        stout=0.95,
        bottom="shorts" if sporty else "trousers",
        bottom_colour="black" if sporty else "denim",
        hair="short",
        bag="none" if sporty else "backpack",
    )
    helmet = "cloth_white" if sporty else "cloth_red"
    limbs = dressed(rest, rider.build, looks, helmet, key=blueprint_id)
    more = ((0, 0), (0, len(Iron)))
    limbs = [replace(limb, weights=np.pad(limb.weights, more)) for limb in limbs]
    limbs += [
        rigid(surface, bone, _BONES, material, Semantic.VEHICLE)
        for surface, bone, material in frame.machine()
    ]
    carried = np.concatenate([moves(rest, postures), frame.moves()], axis=1).astype(np.float32)
    cycle_m = _GEAR * 2 * np.pi * frame.radius
    return puppet(limbs, Gait(cycle_m, carried, rests=False), size)


@dataclass(frozen=True)
class _Frame:
    """Where things are on a bicycle of a size."""

    size: Size

    @property
    def sporty(self) -> bool:
        return self.size[0] < 1.8

    @property
    def radius(self) -> float:
        return min(0.34, 0.215 * self.size[0])

    @property
    def rear(self) -> Floats:
        return xyz(self.radius - self.size[0] / 2, z=self.radius)

    @property
    def front(self) -> Floats:
        return xyz(self.size[0] / 2 - self.radius, z=self.radius)

    @property
    def saddle(self) -> Floats:
        return xyz(-0.14 * self.size[0], z=0.525 * self.size[2])

    @property
    def crank(self) -> Floats:
        return xyz(-0.035 * self.size[0], z=0.28)

    @property
    def head(self) -> Floats:
        """Top of the head tube."""
        return xyz(self.front[0] - 0.13 * self.size[0], z=0.53 * self.size[2])

    @property
    def grip(self) -> Floats:
        x = self.head[0] - (0.0 if self.sporty else 0.24)
        return xyz(x, self.size[1] / 2 - 0.06, self.head[2] + 0.11)

    @property
    def seat(self) -> Seat:
        lean = np.radians(27.0 if self.sporty else 8.0)
        return Seat(self.saddle + xyz(0.01, 0, 0.12), self.grip, self.size[2], lean)

    def pedals(self, turns: Floats) -> Floats:
        """Middles (n, 2, 3) of the left and right pedal after turns (n,) of the cranks."""
        angle = 2 * np.pi * turns[:, None] + np.array([0.0, np.pi])
        x, z = _CRANK_M * np.cos(angle), -_CRANK_M * np.sin(angle)
        y = np.broadcast_to([0.11, -0.11], angle.shape)
        return self.crank + np.stack([x, y, z], axis=-1)

    def soles(self, turns: Floats) -> Floats:
        return self.pedals(turns) + xyz(z=0.012)

    def moves(self) -> Floats:
        """(poses, irons, 3, 4) from no turn of the cranks to every pose."""
        turns = np.arange(POSES) / POSES
        still = np.broadcast_to(np.eye(3, 4), (POSES, 3, 4))
        pedals = self.pedals(turns) - self.pedals(np.zeros(1))
        slid = [still.copy() for _ in range(2)]
        for row, move in enumerate(slid):
            move[:, :, 3] = pedals[:, row]
        rolled = [_rolled(hub, _GEAR * turns) for hub in (self.front, self.rear)]
        return np.stack([still, _rolled(self.crank, turns), *slid, *rolled], axis=1)

    def machine(self) -> Iterator[tuple[Surface, int, str]]:
        """Surfaces, their bones and materials."""
        for surface in self._tubes():
            yield surface, Iron.FRAME, PAINT
        for surface in self._fittings():
            yield surface, Iron.FRAME, "black_plastic"
        lamp, tail = self.head + xyz(0.05, 0, 0.02), self.saddle + xyz(-0.07, 0, -0.12)
        ball = (0.03, 0.03, 0.03)
        yield ellipsoid(lamp, ball, sides=8, bands=4), Iron.FRAME, "lamp_white"
        yield ellipsoid(tail, ball, sides=8, bands=4), Iron.FRAME, "lamp_red"
        yield from self._drive()
        for hub, bone in ((self.front, Iron.FRONT_WHEEL), (self.rear, Iron.REAR_WHEEL)):
            yield tyre(hub, self.radius, 0.022), bone, "rubber"
            for surface in spokes(hub, self.radius):
                yield surface, bone, "metal"

    def _tubes(self) -> list[Surface]:
        low, head, crank = self.head - xyz(-0.02, 0, 0.10), self.head, self.crank
        post = crank + 0.86 * (self.saddle - crank)
        top = post if self.sporty else crank + 0.45 * (self.saddle - crank)
        stays = [
            both_sides(tube([end + xyz(0, 0.02, 0), self.rear + xyz(0, 0.055, 0)], 0.011, sides=5))
            for end in (crank, post)
        ]
        fork = both_sides(
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

    def _fittings(self) -> list[Surface]:
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

    def _drive(self) -> Iterator[tuple[Surface, int, str]]:
        wheel = [self.crank - xyz(0, 0.06, 0), self.crank - xyz(0, 0.045, 0)]
        yield tube(wheel, 0.09, sides=12), Iron.CRANKS, "metal"
        pedals = self.pedals(np.zeros(1))[0]
        for pedal, bone in zip(pedals, (Iron.LEFT_PEDAL, Iron.RIGHT_PEDAL), strict=True):
            inner = np.sign(pedal[1]) * xyz(y=0.065)
            arm = tube([self.crank + inner, pedal * (1, 0, 1) + inner], 0.012, sides=5)
            yield arm, Iron.CRANKS, "metal"
            edge = xyz(0.05, 0.042, 0.012)
            yield box(pedal - edge, pedal + edge), bone, "black_plastic"


def _rolled(hub: Floats, turns: Floats) -> Floats:
    """Moves (n, 3, 4) of a wheel that rolls forward about its hub by turns (n,)."""
    angle = 2 * np.pi * turns
    cosine, sine = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(angle), np.ones_like(angle)
    rows = [cosine, zero, sine, zero, one, zero, -sine, zero, cosine]
    turn = np.stack(rows, axis=-1).reshape(-1, 3, 3)
    return np.concatenate([turn, (hub - turn @ hub)[..., None]], axis=-1)
