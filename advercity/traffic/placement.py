"""Find start positions of background traffic: lanes of the site in the original's areas."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from advercity_dsl import Spec, Vehicle
from advercity_dsl.units import Point2
from numpy.typing import NDArray

from advercity.roads.network_file import SumoLane

START_GAP_M = 5.0
"""Gap between the bodies of vehicles starting in one lane, as in the original."""


@dataclass(frozen=True)
class StartArea:
    """A rectangle in the world's plane."""

    low: Point2
    high: Point2

    @staticmethod
    def from_points(points: Iterable[Point2], margin_m: float) -> "StartArea":
        """Build the bounding box of some points, grown on all sides."""
        corners = np.array(tuple(points))
        west, south = corners.min(axis=0) - margin_m
        east, north = corners.max(axis=0) + margin_m
        return StartArea((float(west), float(south)), (float(east), float(north)))

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether (n,) each of the points (n, 2) lies inside."""
        inside: NDArray[np.bool_] = (points >= self.low) & (points <= self.high)
        return inside[:, 0] & inside[:, 1]


def compute_start_areas(spec: Spec) -> tuple[StartArea, ...]:
    """Compute a square around each agent and a box from each vehicle's spawn to its destination."""
    demand = spec.demand
    places = [agent.place for agent in spec.agents]
    centres = [
        place.spawn_m if isinstance(place, Vehicle) else place.position_m[:2] for place in places
    ]
    squares = [StartArea.from_points([centre], demand.around_agent_m) for centre in centres]
    boxes = [
        StartArea.from_points([place.spawn_m, place.destination_m], demand.around_path_m)
        for place in places
        if isinstance(place, Vehicle)
    ]
    return (*squares, *boxes)


def iterate_start_positions(
    lanes: Iterable[SumoLane], within: Iterable[StartArea], spacing_m: float
) -> Iterator[tuple[SumoLane, float]]:
    """Iterate over positions on the lanes, `spacing_m` apart, inside any of the areas."""
    boxes = tuple(within)
    for lane in lanes:
        positions = np.arange(spacing_m / 2, lane.length_m, spacing_m)
        points = np.array([lane.line.points_at(position)[:2] for position in positions]).reshape(
            -1, 2
        )
        inside = np.any([box.contains(points) for box in boxes], axis=0)
        yield from ((lane, float(position)) for position in positions[inside])


@dataclass(frozen=True)
class LaneOccupancy:
    """Occupied intervals of lanes, by lane."""

    occupied: dict[str, list[tuple[float, float]]] = field(
        default_factory=dict[str, list[tuple[float, float]]]
    )

    def has_room(self, lane: SumoLane, centre_m: float, length_m: float) -> bool:
        """Return whether a body stays clear of junctions and of the bodies in its lane."""
        rear, front = centre_m - length_m / 2, centre_m + length_m / 2
        clear = START_GAP_M / 2
        if rear < clear or front > lane.length_m - clear:
            return False
        return all(
            front + START_GAP_M <= other_rear or rear - START_GAP_M >= other_front
            for other_rear, other_front in self.occupied.get(lane.id, ())
        )

    def occupy(self, lane: SumoLane, centre_m: float, length_m: float) -> None:
        """Add a body."""
        interval = (centre_m - length_m / 2, centre_m + length_m / 2)
        self.occupied.setdefault(lane.id, []).append(interval)
