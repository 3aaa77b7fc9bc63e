"""Declarations of left-hand traffic, mirrored at the x axis into right-hand ones, and back.

All code about lanes knows right-hand traffic alone: layout, SUMO, signals, conflicts, demand and
the scene. It works in the plan frame: the world frame of a right-hand road, or the mirror image (y
negated) of the world frame of a left-hand one. A road in the plan frame is a right-hand road.
"""

from collections.abc import Mapping
from typing import Literal, TypeVar

from advercity_dsl import MapNetwork, Road, RoadsideUnit, Spec, TrajectorySet, Vehicle
from advercity_dsl.conflict import Manoeuvre, StagedConflict
from advercity_dsl.road import (
    AxisArc,
    AxisLine,
    AxisPoints,
    CrossSection,
    EgoRoute,
    Junction,
    SignKind,
    Street,
    Surrounding,
)
from advercity_dsl.road.streets import DrivingSide
from advercity_dsl.units import Point2

from advercity.geometry.mirroring import mirror_point
from advercity.identity_cache import cache_by_identity
from advercity.recordings.track_file import mirror_trajectories

_WordT = TypeVar("_WordT", bound=str)
_DriveT = TypeVar("_DriveT", Vehicle, EgoRoute)
_SIDES: Mapping[str, str] = {"left": "right", "right": "left"}
_SIGNS = {
    SignKind.CURVE_LEFT: SignKind.CURVE_RIGHT,
    SignKind.CURVE_RIGHT: SignKind.CURVE_LEFT,
}
_MAX_ROADS = 64


@cache_by_identity(_MAX_ROADS)
def to_plan_frame(road: Road) -> Road:
    """Return a road in the plan frame; the same object where traffic drives on the right."""
    return mirror_road(road) if road.is_left_hand else road


def to_world_frame(plan: Road, declared: Road) -> Road:
    """Return a road of the plan frame in the world of its declared road."""
    return mirror_road(plan) if declared.is_left_hand else plan


def to_plan_spec(spec: Spec) -> Spec:
    """Return a spec in the plan frame; the same object where traffic drives on the right."""
    if not spec.road.is_left_hand:
        return spec
    agents = tuple(
        agent.model_copy(update={"place": mirror_place(agent.place)}) for agent in spec.agents
    )
    conflicts = tuple(mirror_conflict(item) for item in spec.conflicts)
    road = to_plan_frame(spec.road)
    return spec.model_copy(update={"road": road, "agents": agents, "conflicts": conflicts})


def mirror_road(road: Road) -> Road:
    """Mirror a road: all positions and sides, and the side on which traffic drives.

    A packed network stays as it is, since it is in the plan frame of either road, and so do the
    words of `at_junction`, which are read in the world.
    """
    changes: dict[str, object] = {
        "sections": {name: _mirror_section(item) for name, item in road.sections.items()},
        "streets": {name: _mirror_street(item) for name, item in road.streets.items()},
        "junctions": {name: _mirror_junction(item) for name, item in road.junctions.items()},
        "surroundings": tuple(mirror_surrounding(item) for item in road.surroundings),
        "agents": {name: mirror_place(item) for name, item in road.agents.items()},
        "ego_routes": {
            swap_sides(turn): mirror_route(item) for turn, item in road.ego_routes.items()
        },
    }
    if isinstance(road.imported, MapNetwork):
        side = _other(road.imported.driving_side)
        changes["imported"] = road.imported.model_copy(update={"driving_side": side})
    else:
        changes["driving_side"] = _other(road.driving_side)
    if isinstance(road.trajectories, TrajectorySet):
        changes["trajectories"] = mirror_trajectories(road.trajectories)
    return road.model_copy(update=changes)


def mirror_place(place: Vehicle | RoadsideUnit) -> Vehicle | RoadsideUnit:
    """Mirror where an agent is and where it goes or looks."""
    return mirror_unit(place) if isinstance(place, RoadsideUnit) else mirror_route(place)


def mirror_unit(unit: RoadsideUnit) -> RoadsideUnit:
    """Mirror where a roadside unit is and where it looks."""
    changes = {
        "position_m": mirror_point(unit.position_m),
        "yaw_deg": _negate(unit.yaw_deg),
        "roll_deg": _negate(unit.roll_deg),
    }
    return unit.model_copy(update=changes)


def mirror_route(drive: _DriveT) -> _DriveT:
    """Mirror the start and the destination of a vehicle, or of an alternative route of the ego."""
    changes = {
        "spawn_m": mirror_point(drive.spawn_m),
        "heading_deg": _negate(drive.heading_deg),
        "destination_m": mirror_point(drive.destination_m),
    }
    return drive.model_copy(update=changes)


def mirror_conflict(conflict: StagedConflict) -> StagedConflict:
    """Mirror a staged conflict: its places, and the ego's manoeuvre."""
    actors = tuple(
        actor.model_copy(update={"path_m": _mirror_points(actor.path_m)})
        for actor in conflict.actors
    )
    changes: dict[str, object] = {
        "actors": actors,
        "point_m": mirror_point(conflict.point_m),
        "manoeuvre": swap_sides(conflict.manoeuvre),
    }
    return conflict.model_copy(update=changes)


def name_in_world(manoeuvre: Manoeuvre, road: Road) -> Manoeuvre:
    """Name a manoeuvre of a conflict, declared for right-hand traffic, in a road's world."""
    return swap_sides(manoeuvre) if road.is_left_hand else manoeuvre


def swap_sides(word: _WordT) -> _WordT:
    """Return `left` for `right` and the reverse; other words as they are."""
    return _SIDES.get(word, word)  # type: ignore[return-value]


def mirror_surrounding(item: Surrounding) -> Surrounding:
    """Mirror an object of the surroundings."""
    changes: dict[str, object] = {
        "line_m": _mirror_points(item.line_m),
        "at_m": _mirror_points(item.at_m),
    }
    if item.beside is not None:
        side = swap_sides(item.beside.side)
        changes["beside"] = item.beside.model_copy(update={"side": side})
    if item.area_m is not None:
        changes["area_m"] = _mirror_points(item.area_m)
    if item.sign is not None:
        changes["sign"] = _SIGNS.get(item.sign, item.sign)
    return item.model_copy(update=changes)


def _mirror_section(section: CrossSection) -> CrossSection:
    return section.model_copy(update={"left": section.right, "right": section.left})


def _mirror_street(street: Street) -> Street:
    return street.model_copy(
        update={
            "start_m": mirror_point(street.start_m),
            "heading_deg": _negate(street.heading_deg),
            "path": tuple(_mirror_piece(piece) for piece in street.path),
        }
    )


def _mirror_piece(piece: AxisLine | AxisArc | AxisPoints) -> AxisLine | AxisArc | AxisPoints:
    match piece:
        case AxisArc():
            return piece.model_copy(update={"turn": swap_sides(piece.turn)})
        case AxisPoints():
            return piece.model_copy(update={"points_m": _mirror_points(piece.points_m)})
        case _:
            return piece


def _mirror_junction(junction: Junction) -> Junction:
    signs = tuple(
        sign.model_copy(update={"at_m": mirror_point(sign.at_m)}) for sign in junction.signs
    )
    if junction.signals is None:
        return junction.model_copy(update={"signs": signs})
    heads = tuple(
        head.model_copy(
            update={"at_m": mirror_point(head.at_m), "pole_m": mirror_point(head.pole_m)}
        )
        for head in junction.signals.heads
    )
    signals = junction.signals.model_copy(update={"heads": heads})
    return junction.model_copy(update={"signs": signs, "signals": signals})


def _mirror_points(points: tuple[Point2, ...]) -> tuple[Point2, ...]:
    return tuple(mirror_point(point) for point in points)


def _negate(value: float) -> float:
    """Negate a number without making zeros negative, which would be other bytes in a spec."""
    return 0.0 - value


def _other(side: DrivingSide) -> Literal["right", "left"]:
    return "left" if side == "right" else "right"
