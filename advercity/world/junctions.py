"""Junctions: where streets meet, and how one drives and walks through."""

from dataclasses import dataclass

import numpy as np
from advercity_dsl.road import Crossing, Junction, Movement, StripKind
from numpy.typing import NDArray

from advercity import curves
from advercity.curves import Points
from advercity.errors import InputError
from advercity.streets import Band, StreetLayout

CROSSING_SETBACK_M = 0.6
"""From the end of a street to the crossing that lies before it."""
TIGHTEST_M = 0.5
"""Radius of the inner border of a tight turn."""


@dataclass(frozen=True)
class Arm:
    """The end of a street at a junction, seen from the junction.

    `u` is the offset from the axis in metres, positive to the left when looking out along the arm.
    """

    street: StreetLayout
    at_end: bool
    """Whether the street ends here, rather than begins."""

    @property
    def point(self) -> Points:
        """(3,) end of the axis."""
        return self.street.axis[-1 if self.at_end else 0]

    @property
    def outward(self) -> Points:
        """(2,) unit vector away from the junction."""
        direction = curves.unit(self.street.headings[-1 if self.at_end else 0])
        return -direction if self.at_end else direction

    def at(self, u: float, inward_m: float = 0.0) -> Points:
        """(3,) point at offset `u`, so far inside the junction."""
        plane = self.point[:2] + u * curves.left_of(self.outward) - inward_m * self.outward
        return np.array([*plane, self.point[2]])

    def offset_of(self, t: float) -> float:
        """`u` of an offset `t` of its street."""
        return -t if self.at_end else t

    def bands(self, *, leftwards: bool) -> tuple[Band, ...]:
        """Bands left or right of the axis as seen from the junction, from the axis outwards."""
        return self.street.side(along=self.at_end == leftwards)

    def arriving(self) -> tuple[Band, ...]:
        """Bands that are travelled towards the junction, from the axis outwards."""
        return self.street.side(along=self.at_end)

    def leaving(self) -> tuple[Band, ...]:
        """Bands that are travelled away from the junction, from the axis outwards."""
        return self.street.side(along=not self.at_end)

    def roadway_edge(self, *, leftwards: bool) -> float:
        """`u` where the roadway ends and sidewalk or verge begins."""
        bands = self.bands(leftwards=leftwards)
        edges = [band.outer_t for band in bands if not _is_raised_border(band)]
        return self.offset_of(edges[-1]) if edges else 0.0

    def rim(self, *, leftwards: bool) -> float:
        """`u` of the outer edge of the outermost strip."""
        bands = self.bands(leftwards=leftwards)
        return self.offset_of(bands[-1].outer_t) if bands else 0.0

    def sidewalk(self, *, leftwards: bool) -> tuple[float, float] | None:
        """`u` of the inner and outer edge of the sidewalk, if it borders the roadway."""
        for band in self.bands(leftwards=leftwards):
            if band.kind is StripKind.SIDEWALK:
                return self.offset_of(band.inner_t), self.offset_of(band.outer_t)
        return None


def _is_raised_border(band: Band) -> bool:
    return band.kind in (StripKind.SIDEWALK, StripKind.VERGE)


@dataclass(frozen=True)
class Corner:
    """What lies between two neighbouring arms, counter-clockwise.

    Attributes:
        kerb: (n, 3) edge of the roadway, from the first arm to the second.
        back: (n, 3) outer edge of the sidewalk that runs around it, point by point beside `kerb`;
            None where one of the arms has no sidewalk there.
        rim: (m, 3) edge of all strips, from the outermost of the first arm to that of the second.
    """

    kerb: Points
    back: Points | None
    rim: Points


@dataclass(frozen=True)
class Path:
    """A movement through a junction.

    Attributes:
        id: `<junction>: <movement>`.
        movement: As declared.
        centre: (n, 3) from the end of one lane to the start of the other.
        left: (n, 3) left border, point by point beside `centre`.
        right: (n, 3) right border.
    """

    id: str
    movement: Movement
    centre: Points
    left: Points
    right: Points


@dataclass(frozen=True)
class CrossingLayout:
    """A zebra crossing over an arm.

    Attributes:
        street: Id of the street that is crossed.
        centre: (2, 3) from kerb to kerb.
        width_m: Across `centre`.
    """

    street: str
    centre: Points
    width_m: float


@dataclass(frozen=True)
class JunctionLayout:
    """A junction.

    Attributes:
        id: As declared.
        declared: The declaration.
        arms: Counter-clockwise.
        outline: (n, 3) edge of its roadway, counter-clockwise, open.
        corners: One per arm: from it to the next.
        paths: Movements.
        crossings: Zebra crossings.
        median: (4, 3) the piece of median that runs through it, or None.
    """

    id: str
    declared: Junction
    arms: tuple[Arm, ...]
    outline: Points
    corners: tuple[Corner, ...]
    paths: tuple[Path, ...]
    crossings: tuple[CrossingLayout, ...]
    median: Points | None

    def arm(self, street: str) -> Arm:
        """The arm of a street."""
        return next(arm for arm in self.arms if arm.street.id == street)

    def turn(self, source: str, target: str) -> float:
        """Angle in radians by which one turns from a street into another, positive to the left."""
        out, into = -self.arm(source).outward, self.arm(target).outward
        return float(np.arctan2(out[0] * into[1] - out[1] * into[0], out @ into))

    def height(self, points: Points) -> NDArray[np.float64]:
        """Height (n,) of the roadway at points (n, 2) inside the outline."""
        return surface_height(self.outline, points)


def lay_junction(name: str, declared: Junction, streets: dict[str, StreetLayout]) -> JunctionLayout:
    """Lay out a declared junction between sampled streets; InputError where they do not fit."""
    arms = _arms(name, streets)
    corners = tuple(
        _corner(arm, following, declared.corner_radius_m)
        for arm, following in zip(arms, (*arms[1:], arms[0]), strict=True)
    )
    outline = np.concatenate([corner.kerb for corner in corners])
    by_street = {arm.street.id: arm for arm in arms}
    return JunctionLayout(
        id=name,
        declared=declared,
        arms=arms,
        outline=outline,
        corners=corners,
        paths=tuple(
            _path(name, text, by_street, outline, declared.turn_radius_m or np.inf)
            for text in declared.movements
        ),
        crossings=tuple(_crossing(item, by_street[item.street]) for item in declared.crossings),
        median=_median(name, declared.median, by_street) if declared.median else None,
    )


def _arms(name: str, streets: dict[str, StreetLayout]) -> tuple[Arm, ...]:
    arms = [
        Arm(street, at_end=street.ends == name)
        for street in streets.values()
        if name in (street.begins, street.ends)
    ]
    if len(arms) < 2:
        raise InputError(
            f"junctions.{name}: only '{arms[0].street.id}' meets here; a junction joins two "
            "streets or more (a street that ends at the edge of the site needs none)"
        )
    middle = np.mean([arm.point[:2] for arm in arms], axis=0)
    return tuple(sorted(arms, key=lambda arm: float(np.arctan2(*(arm.point[:2] - middle)[::-1]))))


def _corner(arm: Arm, following: Arm, radius_m: float) -> Corner:
    kerb = _link(
        arm,
        arm.roadway_edge(leftwards=True),
        following,
        following.roadway_edge(leftwards=False),
        radius_m,
    )
    here, there = arm.sidewalk(leftwards=True), following.sidewalk(leftwards=False)
    ends = arm.at(arm.rim(leftwards=True)), following.at(following.rim(leftwards=False))
    if here is None or there is None:
        return Corner(kerb=kerb, back=None, rim=_chain(ends[0], kerb, ends[1]))
    width = max(abs(here[1] - here[0]), abs(there[1] - there[0]))
    back = _link(arm, here[1], following, there[1], max(radius_m - width, TIGHTEST_M))
    count = max(len(kerb), len(back))
    kerb, back = (
        line if len(line) == count else curves.resampled(line, count) for line in (kerb, back)
    )
    return Corner(kerb=kerb, back=back, rim=_chain(ends[0], back, ends[1]))


def _chain(*parts: Points) -> Points:
    return curves.without_repeats(np.vstack(parts))


def _link(arm: Arm, u: float, following: Arm, v: float, radius_m: float) -> Points:
    start, end = arm.at(u), following.at(v)
    plane = curves.link(start[:2], -arm.outward, end[:2], following.outward, radius_m=radius_m)
    along = curves.stations(plane)
    z = np.interp(along / along[-1], [0.0, 1.0], [start[2], end[2]])
    return np.column_stack([plane, z])


def _path(
    name: str, text: str, arms: dict[str, Arm], outline: Points, turn_radius_m: float
) -> Path:
    movement = Movement.read(text)
    source, target = arms[movement.from_street], arms[movement.to_street]
    leaving = source.street.lane(movement.from_lane, along=source.at_end)
    entering = target.street.lane(movement.to_lane, along=not target.at_end)
    out, into = -source.outward, target.outward
    leftwards = np.sign(out[0] * into[1] - out[1] * into[0])

    def through(first_t: float, last_t: float, left_m: float = 0.0) -> Points:
        """A way that runs `left_m` beside the middle one, around the same centre."""
        start, end = source.at(source.offset_of(first_t)), target.at(target.offset_of(last_t))
        radius = max(turn_radius_m - leftwards * left_m, TIGHTEST_M)
        return curves.link(start[:2], out, end[:2], into, radius_m=radius)

    centre = through(leaving.centre_t, entering.centre_t)
    half = leaving.width_m / 2
    count = max(2, int(np.ceil(curves.length(centre))) + 1)
    lines = [
        curves.resampled(line, count)
        for line in (
            centre,
            through(leaving.inner_t, entering.inner_t, half),
            through(leaving.outer_t, entering.outer_t, -half),
        )
    ]
    z = surface_height(outline, lines[0])
    z[0], z[-1] = source.point[2], target.point[2]
    centre, left, right = (np.column_stack([line, z]) for line in lines)
    return Path(f"{name}: {text}", movement, centre, left, right)


def _crossing(declared: Crossing, arm: Arm) -> CrossingLayout:
    inward = CROSSING_SETBACK_M + declared.width_m / 2
    ends = [arm.at(arm.roadway_edge(leftwards=side), inward) for side in (False, True)]
    return CrossingLayout(declared.street, np.stack(ends), declared.width_m)


def _median(name: str, between: tuple[str, str], arms: dict[str, Arm]) -> Points:
    edges: list[Points] = []
    for street in between:
        arm = arms[street]
        widths = [
            [band.outer_t for band in bands if band.kind is StripKind.MEDIAN]
            for bands in (arm.street.left, arm.street.right)
        ]
        if not all(widths):
            raise InputError(
                f"junctions.{name}.median: '{street}' has no median on both sides of its axis"
            )
        offsets = sorted(arm.offset_of(side[-1]) for side in widths)
        edges += [arm.at(u) for u in offsets]
    return np.stack(edges)


def surface_height(outline: Points, points: Points) -> NDArray[np.float64]:
    """Height inside a polygon, by mean value coordinates of its corners.

    They reproduce heights that lie in a plane and are linear along every side of the polygon
    (Hormann and Floater, ACM Transactions on Graphics 25, 2006).

    Args:
        outline: (m, 3) polygon, counter-clockwise, open.
        points: (n, 2) inside it or on it.

    Returns:
        (n,) metres.
    """
    to_corner = outline[None, :, :2] - points[:, None]
    distance = np.linalg.norm(to_corner, axis=2)
    following = np.roll(to_corner, -1, axis=1)
    cross = to_corner[..., 0] * following[..., 1] - to_corner[..., 1] * following[..., 0]
    dot = (to_corner * following).sum(axis=2)
    half_angle = np.tan(np.arctan2(cross, dot) / 2)
    weight = (half_angle + np.roll(half_angle, 1, axis=1)) / np.maximum(distance, 1e-9)
    z = (weight @ outline[:, 2]) / weight.sum(axis=1)
    nearest = distance.argmin(axis=1)
    return np.where(distance.min(axis=1) < 1e-6, outline[nearest, 2], z)
