"""A left-hand road in its world, as the mirror image of its network in the plan frame."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import shapely
from advercity_dsl import Road
from shapely.geometry.base import BaseGeometry

from advercity.geometry.mesh import Mesh
from advercity.geometry.mirroring import mirror_mesh, mirror_point, mirror_points
from advercity.geometry.polyline import Points
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.signals import TrafficLight, TrafficSign
from advercity.roads.streets import StreetLayout, StripLayout

if TYPE_CHECKING:
    from advercity.roads.road_network import RoadNetwork


class MirroredRoadNetwork:
    """A `RoadNetwork`, mirrored at the x axis."""

    def __init__(self, road: Road, plan: "RoadNetwork") -> None:
        """Mirror the network `plan` of the plan frame into the world of `road`."""
        self.declaration = road
        self._plan = plan
        self.streets: Mapping[str, StreetLayout] = {
            name: mirror_street(item) for name, item in plan.streets.items()
        }

    @cached_property
    def lanes(self) -> tuple[LaneSegment, ...]:
        """Lanes with the ids of the plan."""
        return tuple(mirror_lane(lane) for lane in self._plan.lanes)

    @property
    def meshes(self) -> list[Mesh]:
        """Roadways, kerbs, sidewalks and paint."""
        return [mirror_mesh(mesh) for mesh in self._plan.meshes]

    @cached_property
    def paved_edges(self) -> list[Points]:
        """Edges of all paving, which is on their left."""
        return [mirror_points(edge)[::-1] for edge in self._plan.paved_edges]

    @cached_property
    def paved_area(self) -> BaseGeometry:
        """Area of all paving."""
        return _mirror_area(self._plan.paved_area)

    @property
    def street_axes(self) -> BaseGeometry:
        """Axes of the streets."""
        return _mirror_area(self._plan.street_axes)

    @property
    def roadway_level_area(self) -> BaseGeometry:
        """Area in which pedestrians walk at the height of the roadway."""
        return _mirror_area(self._plan.roadway_level_area)

    @cached_property
    def traffic_lights(self) -> tuple[TrafficLight, ...]:
        """Signal heads."""
        return tuple(
            replace(
                light,
                position_m=mirror_point(light.position_m),
                mast_foot_m=mirror_point(light.mast_foot_m),
                facing=mirror_point(light.facing),
            )
            for light in self._plan.traffic_lights
        )

    @property
    def traffic_signs(self) -> tuple[TrafficSign, ...]:
        """Stop and give-way signs."""
        return tuple(
            replace(
                sign,
                position_m=mirror_point(sign.position_m),
                facing=mirror_point(sign.facing),
            )
            for sign in self._plan.traffic_signs
        )


def mirror_lane(lane: LaneSegment) -> LaneSegment:
    """Mirror a lane: its left border becomes the right one."""
    return replace(lane, left=mirror_points(lane.right), right=mirror_points(lane.left))


def mirror_street(street: StreetLayout) -> StreetLayout:
    """Mirror a street: strips on its left come to the right, and traffic to the other side."""
    return replace(
        street,
        axis=mirror_points(street.axis),
        headings=-street.headings,
        left_strips=tuple(_mirror_strip(strip) for strip in street.right_strips),
        right_strips=tuple(_mirror_strip(strip) for strip in street.left_strips),
        is_left_hand=not street.is_left_hand,
    )


def _mirror_strip(strip: StripLayout) -> StripLayout:
    return replace(strip, inner_t=-strip.inner_t, outer_t=-strip.outer_t)


def _mirror_area(area: BaseGeometry) -> BaseGeometry:
    return shapely.transform(area, mirror_points)
