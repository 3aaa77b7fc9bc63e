"""People: a figure of smooth limbs in any pose, and pedestrians in mid-stride."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world.materials import PAINT
from advercity.world.shapes import Floats, Piece, Surface, ellipsoid, loft, tube, xyz

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Side:
    """Joints of the left or right arm and leg, metres in the body frame."""

    shoulder: Floats
    elbow: Floats
    hand: Floats
    hip: Floats
    knee: Floats
    ankle: Floats
    toe: Floats


@dataclass(frozen=True)
class Pose:
    """Where a figure's joints are."""

    pelvis: Floats
    neck: Floats
    head: Floats
    sides: tuple[Side, Side]


@dataclass(frozen=True)
class Looks:
    """Build and clothes of a figure."""

    height_m: float
    """Standing height, which sets the thickness of everything."""
    half_breadth_m: float
    """Half the breadth of the shoulders, arms not counted."""
    half_depth_m: float
    coat: str = PAINT
    trousers: str = "cloth_dark"
    hair: str = "black_plastic"
    helmet: str | None = None
    visor: bool = False
    skirt: bool = False
    backpack: bool = False


def bent(start: ArrayLike, end: ArrayLike, upper_m: float, lower_m: float, to: ArrayLike) -> Floats:
    """The elbow or knee between two joints, on the side that `to` points at.

    Limbs that are too short to reach are stretched.
    """
    first, last = np.asarray(start, float), np.asarray(end, float)
    line = last - first
    distance = float(np.linalg.norm(line))
    along = line / distance
    reach = min(1.0, distance / (upper_m + lower_m))
    foot = upper_m / (upper_m + lower_m) * distance
    height = upper_m * np.sqrt(max(0.0, 1 - reach**2))
    side = np.asarray(to, float) - np.dot(to, along) * along
    return first + foot * along + height * side / np.linalg.norm(side)


def figure(pose: Pose, looks: Looks) -> list[Piece]:
    """Pieces of a dressed figure."""
    unit = looks.height_m / 1.75
    coat, legs = [_torso(pose, looks)], list[Surface]()
    skin, shoes = [tube([pose.neck, pose.head], 0.052 * unit)], list[Surface]()
    for side in pose.sides:
        thick = 0.8 * min(unit, looks.half_depth_m / 0.13)
        arm = [side.shoulder, side.elbow, _toward(side.hand, side.elbow, 0.06 * unit)]
        coat.append(tube(arm, np.array([0.065, 0.054, 0.043]) * thick, rounded=True))
        skin.append(ellipsoid(side.hand, np.array([0.045, 0.032, 0.05]) * unit, sides=8, bands=3))
        bend = [side.hip, side.knee, _toward(side.ankle, side.knee, 0.04 * unit)]
        bare = skin if looks.skirt else legs
        bare.append(tube(bend, np.array([0.088, 0.066, 0.046]) * unit, sides=8, rounded=True))
        shoes.append(_shoe(side.ankle, side.toe, unit))
    if looks.skirt:
        legs.append(_skirt(pose, looks))
    pieces = [
        *((part, looks.coat) for part in coat),
        *((part, looks.trousers) for part in legs),
        *((part, "skin") for part in skin),
        *((part, "black_plastic") for part in shoes),
        *_head(pose, looks, unit),
    ]
    if looks.backpack:
        middle = (pose.pelvis + 2 * pose.neck) / 3 + xyz(-0.8 * looks.half_depth_m, 0, -0.02)
        pack = ellipsoid(middle, np.array([0.10, 0.14, 0.22]) * unit, sides=8, bands=4)
        pieces.append((pack, "cloth_dark"))
    return [Piece(part, material, Semantic.PEDESTRIAN) for part, material in pieces]


def _toward(point: Floats, other: Floats, distance_m: float) -> Floats:
    step = other - point
    return point + distance_m * step / np.linalg.norm(step)


def _torso(pose: Pose, looks: Looks) -> Surface:
    spine = pose.neck - pose.pelvis
    share = np.array([-0.30, -0.27, -0.12, 0.10, 0.36, 0.66, 0.88, 0.98, 1.03])
    breadth = (
        np.array([0.62, 0.74, 0.84, 0.82, 0.76, 0.94, 0.98, 0.70, 0.30]) * looks.half_breadth_m
    )
    depth = np.array([0.74, 0.90, 1.0, 0.94, 0.82, 0.98, 0.84, 0.62, 0.40]) * looks.half_depth_m
    up = spine / np.linalg.norm(spine)
    left = np.array([0.0, 1.0, 0.0])
    fore = np.cross(left, up)
    angle = 2 * np.pi * np.arange(12) / 12
    rings = [
        pose.pelvis
        + s * spine
        + b * np.outer(np.sin(angle), left)
        + d * np.outer(np.cos(angle), fore)
        for s, b, d in zip(share, breadth, depth, strict=True)
    ]
    return loft(np.stack(rings))


def _skirt(pose: Pose, looks: Looks) -> Surface:
    knees = (pose.sides[0].knee + pose.sides[1].knee) / 2
    angle = 2 * np.pi * np.arange(12) / 12
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(12)])
    stride = max(abs(side.knee[0]) for side in pose.sides)
    thigh = 0.09 * looks.height_m / 1.75
    size = xyz(stride + thigh, pose.sides[0].hip[1] + thigh, 1.0)
    hem = (pose.pelvis[0], pose.pelvis[1], knees[2] - 0.03)
    spread = np.array([1.0, 1.02, 1.06])[:, None, None]
    centres = np.linspace(pose.pelvis, hem, 3)[:, None]
    return loft(centres + spread * circle * size)


def _shoe(ankle: Floats, toe: Floats, unit: float) -> Surface:
    along = toe - ankle
    heel = ankle - 0.22 * along
    tip = toe
    axis = np.linspace(heel, tip, 4)
    axis[:, 2] = np.linspace(heel[2], tip[2], 4)
    return tube(axis, np.array([0.042, 0.048, 0.048, 0.036]) * unit, sides=8)


def _head(pose: Pose, looks: Looks, unit: float) -> list[tuple[Surface, str]]:
    # Heads of children are nearly as large as those of adults.
    size = 0.5 + 0.5 * unit
    head = ellipsoid(pose.head, np.array([0.098, 0.078, 0.125]) * size, sides=12, bands=6)
    if looks.helmet:
        shell = ellipsoid(pose.head + xyz(-0.005, 0, 0.03), np.array([0.14, 0.115, 0.125]) * size)
        if not looks.visor:
            return [(head, "skin"), (shell, looks.helmet)]
        visor = ellipsoid(pose.head + xyz(0.05, 0, 0.0), np.array([0.095, 0.09, 0.055]) * size)
        return [(head, "skin"), (shell, looks.helmet), (visor, "glass")]
    hair = ellipsoid(pose.head + xyz(-0.022, 0, 0.022), np.array([0.098, 0.086, 0.115]) * size)
    face = ellipsoid(pose.head + xyz(0.03, 0, -0.02), np.array([0.075, 0.07, 0.1]) * size, bands=4)
    nose = ellipsoid(
        pose.head + xyz(0.103 * size, 0, -0.02), (0.014, 0.012, 0.02), sides=6, bands=4
    )
    return [(head, "skin"), (hair, looks.hair), (face, "skin"), (nose, "skin")]


def pedestrian(blueprint_id: str, size: Point) -> list[Piece]:
    """Pieces of a person of about `size` who walks along x, in mid-stride."""
    length, width, height = size
    draw = generator("pedestrian", blueprint_id)
    child = height < 1.45
    looks = Looks(
        height_m=height,
        half_breadth_m=0.37 * width,
        half_depth_m=0.30 * length,
        trousers=str(draw.choice(["cloth_dark", "cloth_blue", "cloth_light", "cloth_dark"])),
        hair=str(draw.choice(["black_plastic", "bark", "wood", "cloth_light"])),
        skirt=bool(draw.random() < 0.25),
        backpack=bool(draw.random() < (0.6 if child else 0.2)),
    )
    return figure(_walking(length, width, height, child), looks)


def _walking(length: float, width: float, height: float, child: bool) -> Pose:
    leg = (0.48 if child else 0.52) * height
    shoulder = (0.79 if child else 0.82) * height
    head = height - 0.125 * (0.5 + 0.5 * height / 1.75)
    step = 0.27 * length

    def side(left: float, swing: float) -> Side:
        """One side; `swing` is 1 for the leg in front, whose arm swings back."""
        hip = np.array([0.0, left * 0.19 * width, leg])
        lifted = 0.055 * height if swing < 0 else 0.045 * height
        ankle = np.array([swing * step - 0.02, left * 0.16 * width, lifted])
        toe = ankle + xyz(0.080 * height, left * 0.01, -0.02 * height)
        if swing < 0:
            toe = ankle + xyz(0.070 * height, left * 0.01, -0.032 * height)
        thigh = (0.505 if swing > 0 else 0.52) * float(np.linalg.norm(ankle - hip))
        top = np.array([0.0, left * 0.37 * width, shoulder - 0.03 * height])
        hand = np.array([-swing * 1.3 * step + 0.03, left * 0.40 * width, 0.465 * height])
        return Side(
            shoulder=top,
            elbow=bent(top, hand, 0.17 * height, 0.18 * height, (-1.0, left * 0.2, 0.0)),
            hand=hand,
            hip=hip,
            knee=bent(hip, ankle, thigh, thigh, (1.0, 0.0, 0.0)),
            ankle=ankle,
            toe=toe,
        )

    return Pose(
        pelvis=np.array([0.0, 0.0, leg + 0.06 * height]),
        neck=np.array([0.01, 0.0, shoulder + 0.02 * height]),
        head=np.array([0.025, 0.0, head]),
        sides=(side(1.0, 1.0), side(-1.0, -1.0)),
    )
