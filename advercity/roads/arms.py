"""Ends of declared streets at a junction, and the movements between them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from advercity_dsl.base import ValuePath
from advercity_dsl.road import Junction, Movement, Sign, StripKind

from advercity.errors import InputError
from advercity.geometry import polyline
from advercity.geometry.polyline import Points
from advercity.roads.streets import StreetLayout, StripLayout

MAX_ARM_DISTANCE_M = 50.0
"""Distance of a street's end from the middle of the other ends at its junction."""
STRAIGHT_TURN_RAD = np.pi / 4
"""Without declared movements, outer and inner lanes turn by more than this."""


class MisplacedPartError(InputError):
    """A part of a road cannot be where it is declared.

    Attributes:
        value_path: Path of the value to change, in the road.
    """

    def __init__(self, value_path: ValuePath, message: str) -> None:
        super().__init__(message)
        self.value_path = value_path


@dataclass(frozen=True)
class JunctionArm:
    """The end of a street at a junction, seen from the junction.

    `u` is the offset from the axis in metres, positive to the left when looking out along the arm.
    """

    street: StreetLayout
    is_street_end: bool
    """Whether the street ends here, rather than begins."""

    @property
    def axis_end(self) -> Points:
        """(3,) end of the axis at the junction."""
        return self.street.axis[-1 if self.is_street_end else 0]

    @property
    def outward_direction(self) -> Points:
        """(2,) unit vector away from the junction."""
        direction = polyline.unit_vectors(self.street.headings[-1 if self.is_street_end else 0])
        return -direction if self.is_street_end else direction

    def point_at(self, u: float, inward_m: float = 0.0) -> Points:
        """Compute the point (3,) at offset `u`, `inward_m` inside the junction."""
        plane = (
            self.axis_end[:2]
            + u * polyline.left_normals(self.outward_direction)
            - inward_m * self.outward_direction
        )
        return np.array([*plane, self.axis_end[2]])

    def to_arm_offset(self, t: float) -> float:
        """Convert an offset `t` of its street to `u`."""
        return -t if self.is_street_end else t

    def strips_on_side(self, *, leftwards: bool) -> tuple[StripLayout, ...]:
        """Strips left or right of the axis seen from the junction, from the axis outwards."""
        return self.street.strips_in_direction(along=self.is_street_end == leftwards)

    def inbound_strips(self) -> tuple[StripLayout, ...]:
        """List strips for travel towards the junction, from the axis outwards."""
        return self.street.strips_in_direction(along=self.is_street_end)

    def outbound_strips(self) -> tuple[StripLayout, ...]:
        """List strips for travel away from the junction, from the axis outwards."""
        return self.street.strips_in_direction(along=not self.is_street_end)

    def roadway_edge_offset(self, *, leftwards: bool) -> float:
        """Compute `u` of the edge between the roadway and the sidewalk or verge."""
        strips = self.strips_on_side(leftwards=leftwards)
        edges = [strip.outer_t for strip in strips if not _is_raised_border(strip)]
        return self.to_arm_offset(edges[-1]) if edges else 0.0

    def outer_edge_offset(self, *, leftwards: bool) -> float:
        """Compute `u` of the outer edge of the outermost strip."""
        strips = self.strips_on_side(leftwards=leftwards)
        return self.to_arm_offset(strips[-1].outer_t) if strips else 0.0

    def sidewalk_offsets(self, *, leftwards: bool) -> tuple[float, float] | None:
        """Compute `u` of the inner and outer edge of the sidewalk; None without one."""
        for strip in self.strips_on_side(leftwards=leftwards):
            if strip.kind is StripKind.SIDEWALK:
                return self.to_arm_offset(strip.inner_t), self.to_arm_offset(strip.outer_t)
        return None

    def place_stop_sign(self) -> Sign:
        """Place a stop sign for arriving traffic, at the outer edge of its strips."""
        outer_t = self.inbound_strips()[-1].outer_t
        east, north, _ = self.point_at(self.to_arm_offset(outer_t))
        return Sign(street=self.street.id, kind="stop", at_m=(round(east, 2), round(north, 2)))

    def turn_angle(self, target: "JunctionArm") -> float:
        """Compute the angle in radians into another arm, positive to the left."""
        out, into = -self.outward_direction, target.outward_direction
        return float(np.arctan2(out[0] * into[1] - out[1] * into[0], out @ into))


def _is_raised_border(strip: StripLayout) -> bool:
    return strip.kind in (StripKind.SIDEWALK, StripKind.VERGE)


def build_arms(name: str, streets: Mapping[str, StreetLayout]) -> tuple[JunctionArm, ...]:
    """List the ends of streets at a declared junction, counter-clockwise.

    Raises:
        MisplacedPartError: There is one only, or one does not reach the junction, or leads away
            from it.
    """
    arms = [
        JunctionArm(street, is_street_end=street.ends == name)
        for street in streets.values()
        if name in (street.begins, street.ends)
    ]
    if len(arms) < 2:
        message = (
            f"only '{arms[0].street.id}' leads to it; a junction joins two streets or more (a"
            " street that ends at the edge of the site needs none)"
        )
        raise MisplacedPartError(("junctions", name), message)
    for arm in arms:
        _check_arm(name, arm, [other for other in arms if other is not arm])
    middle = np.mean([arm.axis_end[:2] for arm in arms], axis=0)
    return tuple(
        sorted(arms, key=lambda arm: float(np.arctan2(*(arm.axis_end[:2] - middle)[::-1])))
    )


def _check_arm(name: str, arm: JunctionArm, others: list[JunctionArm]) -> None:
    """Check that a street reaches its junction, and leads into it."""
    inward = np.mean([other.axis_end[:2] for other in others], axis=0) - arm.axis_end[:2]
    distance_m = float(np.linalg.norm(inward))
    end = "ends" if arm.is_street_end else "begins"
    east, north = np.round(arm.axis_end[:2], 1) + 0.0
    message = f"{end} at {east}, {north}"
    if distance_m > MAX_ARM_DISTANCE_M:
        message += (
            f", {distance_m:.0f} m from the other streets of junction '{name}'; the limit is"
            f" {MAX_ARM_DISTANCE_M:g} m: change its `path` or `start_m`"
        )
    elif arm.outward_direction @ inward > 0:
        message += f" and leads away from junction '{name}' there; turn it, or swap its ends"
    else:
        return
    raise MisplacedPartError(("streets", arm.street.id, "path"), message)


def complete_stop_signs(declared: Junction, arms: Sequence[JunctionArm]) -> Junction:
    """Add a stop sign for every arriving street of an all-way stop that declares none."""
    if declared.control != "all_way_stop":
        return declared
    signed = {sign.street for sign in declared.signs}
    arriving = (arm for arm in arms if _count_lanes(arm.inbound_strips()))
    added = (arm.place_stop_sign() for arm in arriving if arm.street.id not in signed)
    return declared.model_copy(update={"signs": (*declared.signs, *added)})


def list_movements(declared: Junction, arms: Sequence[JunctionArm]) -> list[Movement]:
    """List the declared movements of a junction, or all."""
    if declared.movements == "all":
        return [*_list_all_movements(arms)]
    return [Movement.parse(text) for text in declared.movements]


def _list_all_movements(arms: Sequence[JunctionArm]) -> Iterator[Movement]:
    """List movements from every street into every other one.

    Left turns leave from the innermost lane and right turns from the outermost one; lanes straight
    ahead keep their number as far as the other street has so many.
    """
    for source in arms:
        count = _count_lanes(source.inbound_strips())
        for target in arms:
            room = _count_lanes(target.outbound_strips())
            if source is target or not count or not room:
                continue
            angle = source.turn_angle(target)
            if angle > STRAIGHT_TURN_RAD:
                pairs = [(1, 1)]
            elif angle < -STRAIGHT_TURN_RAD:
                pairs = [(count, room)]
            else:
                pairs = [(lane, min(lane, room)) for lane in range(1, count + 1)]
            for leaving, entering in pairs:
                yield Movement(source.street.id, leaving, target.street.id, entering)


def _count_lanes(strips: tuple[StripLayout, ...]) -> int:
    return sum(strip.kind is StripKind.LANE for strip in strips)
