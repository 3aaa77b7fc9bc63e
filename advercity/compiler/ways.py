"""Ways through a declared road: lane centre lines of streets, joined inside junctions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from advercity_dsl import Road, Vehicle
from advercity_dsl.road import Movement, StripKind
from numpy.typing import ArrayLike, NDArray

from advercity import curves
from advercity.streets import Band, StreetLayout, lay_street

FINE_M = 0.25
MEETS_M = 1.0
"""Ways that come nearer than this to each other cross."""
LANE_CHANGE_M = 30.0
"""Length over which a vehicle goes from one lane to another."""


Taken = tuple[str, bool, int, int]
"""A street, whether along its axis, the lane it is entered in and the one it is left in."""


@dataclass(frozen=True)
class Stretch:
    """A street on a way.

    Attributes:
        street: The street.
        along: Whether the way follows its axis.
        lane: Number of the lane at its end, 1 is the innermost.
        begins_m: Station on the way where it begins.
        ends_m: The same where it ends.
    """

    street: StreetLayout
    along: bool
    lane: int
    begins_m: float
    ends_m: float

    def bands(self, *, right: bool) -> tuple[Band, ...]:
        """Strips on either side of the axis as seen in the direction of travel."""
        return self.street.side(along=self.along == right)

    def lateral(self, t: float) -> float:
        """Offset to the left of the lane's centre, in the direction of travel, of an offset `t`."""
        centre = self.street.lane(self.lane, along=self.along).centre_t
        return (t - centre) if self.along else (centre - t)


@dataclass(frozen=True, eq=False)
class Way:
    """A polyline with the streets that it follows.

    Attributes:
        points: (n, 2) metres, from the start of its first street.
        stretches: Its streets in order.
    """

    points: NDArray[np.float64]
    stretches: tuple[Stretch, ...]

    @cached_property
    def stations_m(self) -> NDArray[np.float64]:
        """(n,) metres along the way."""
        return curves.stations(self.points)

    @property
    def length_m(self) -> float:
        """To its end."""
        return float(self.stations_m[-1])

    def at(self, station_m: float, left_m: float = 0.0) -> NDArray[np.float64]:
        """Point (2,) at a station, so far to its left."""
        place = self._places(np.array([station_m]))[0]
        return place + left_m * curves.left_of(curves.unit(self.heading(station_m)))

    def heading(self, station_m: float) -> float:
        """Direction of travel at a station, radians counter-clockwise from east."""
        return float(self.headings(np.array([station_m]))[0])

    def headings(self, stations_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions of travel (m,) at stations (m,)."""
        ahead = self._places(np.minimum(stations_m + 0.5, self.length_m))
        east, north = (ahead - self._places(np.maximum(stations_m - 0.5, 0.0))).T
        return np.arctan2(north, east)

    def nearest(self, point: ArrayLike) -> float:
        """The station nearest to a point (2,)."""
        return float(self._fine[np.argmin(self._gaps(np.asarray(point)[None])[:, 0])])

    def crossing(self, other: "Way") -> float | None:
        """The station where another way crosses this one; None if it does not."""
        gaps = self._gaps(other.points_every(FINE_M)).min(axis=1)
        if gaps.min() > MEETS_M:
            return None
        return float(self._fine[np.argmax(gaps <= max(MEETS_M / 2, gaps.min()))])

    def points_every(self, step_m: float) -> NDArray[np.float64]:
        """Points (n, 2) along it."""
        return self._places(np.arange(0.0, self.length_m, step_m))

    @cached_property
    def _fine(self) -> NDArray[np.float64]:
        return np.arange(0.0, self.length_m, FINE_M)

    def _places(self, stations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (m, 2) at stations (m,)."""
        columns = [np.interp(stations, self.stations_m, axis) for axis in self.points.T]
        return np.stack(columns, axis=-1)

    def _gaps(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances (n, m) of points (m, 2) from the way's every `FINE_M`."""
        here = self._places(self._fine)
        east, north = (np.subtract.outer(here[:, axis], points[:, axis]) for axis in (0, 1))
        return np.sqrt(east * east + north * north)


@dataclass(frozen=True, eq=False)
class RoadWays:
    """Finds ways through a declared road."""

    road: Road

    @cached_property
    def streets(self) -> dict[str, StreetLayout]:
        """Every street, sampled."""
        return {name: lay_street(name, item, self.road) for name, item in self.road.streets.items()}

    @cached_property
    def movements(self) -> dict[str, tuple[Movement, ...]]:
        """By junction."""
        return {
            name: tuple(Movement.read(text) for text in junction.movements)
            for name, junction in self.road.junctions.items()
        }

    def junction_between(self, first: str, second: str) -> str | None:
        """The junction at which one goes from a street into another."""
        for name, movements in self.movements.items():
            if any(item.from_street == first and item.to_street == second for item in movements):
                return name
        return None

    def arrives(self, street: str, junction: str) -> bool:
        """Whether travelling towards a junction on a street follows the street's axis."""
        return self.streets[street].ends == junction

    def inbound(self, street: str, junction: str) -> float:
        """Heading with which a street is driven into a junction."""
        layout = self.streets[street]
        at_end = layout.ends == junction
        return float(layout.headings[-1] if at_end else layout.headings[0] + np.pi)

    def turn(self, movement: Movement, junction: str) -> float:
        """By how much a movement turns, in (-pi, pi]; positive to the left."""
        leaves = self.inbound(movement.to_street, junction) + np.pi
        turned = leaves - self.inbound(movement.from_street, junction)
        return float(np.pi - (np.pi - turned) % (2 * np.pi))

    def route(self, streets: Sequence[str], lane: int | None = None) -> Way:
        """The way along streets, in the lanes that lead from each into the next.

        Args:
            streets: Ids in order.
            lane: Number of the lane on the first street, if it matters.
        """
        return self._joined(list(self._lanes(streets, lane)))

    def _lanes(self, streets: Sequence[str], lane: int | None) -> Iterator[Taken]:
        fitting = self._fitting(streets)
        entered = lane
        for index, street in enumerate(streets):
            along = self.along(streets, index)
            leaves = fitting[index]
            start = entered if entered is not None else min(leaves)
            left = min(leaves, key=lambda number: abs(number - start))
            yield street, along, start, left
            if index + 1 < len(streets):
                entered = next(
                    item.to_lane
                    for items in self.movements.values()
                    for item in items
                    if (item.from_street, item.from_lane, item.to_street)
                    == (street, left, streets[index + 1])
                    and item.to_lane in (fitting[index + 1] or {item.to_lane})
                )

    def _fitting(self, streets: Sequence[str]) -> list[set[int]]:
        """Per street, the lanes from which the rest of the streets can be reached."""
        along = self.along(streets, len(streets) - 1)
        last = {band.number for band in self.streets[streets[-1]].side(along=along) if band.number}
        fitting = [last]
        for first, second in reversed(list(pairwise(streets))):
            ways = [
                item
                for items in self.movements.values()
                for item in items
                if item.from_street == first and item.to_street == second
            ]
            good = {item.from_lane for item in ways if item.to_lane in fitting[0]}
            fitting.insert(0, good or {item.from_lane for item in ways})
        return fitting

    def along(self, streets: Sequence[str], index: int) -> bool:
        """Whether a route follows the axis of one of its streets; one street alone does."""
        if len(streets) == 1:
            return True
        if index + 1 < len(streets):
            junction = self.junction_between(streets[index], streets[index + 1])
            return self.streets[streets[index]].ends == junction
        junction = self.junction_between(streets[index - 1], streets[index])
        return self.streets[streets[index]].begins == junction

    def _joined(self, taken: Sequence[Taken]) -> Way:
        pieces: list[NDArray[np.float64]] = []
        stretches: list[Stretch] = []
        for name, along, entered, left in taken:
            street = self.streets[name]
            line = _lane_line(street, entered, along=along)
            if left != entered:
                target = street.travelled(street.lane(left, along=along).centre_t, along=along)[
                    :, :2
                ]
                fine = max(int(curves.length(line)), 2)
                line, target = curves.resampled(line, fine), curves.resampled(target, fine)
                share = np.clip(curves.stations(line) / LANE_CHANGE_M, 0, 1)[:, None]
                line = (1 - share) * line + share * target
            if pieces:
                pieces.append(_link(pieces[-1], line)[1:-1])
            begins = curves.length(np.concatenate([*pieces, line[:1]])) if pieces else 0.0
            pieces.append(line)
            stretches.append(Stretch(street, along, left, begins, begins + curves.length(line)))
        return Way(curves.without_repeats(np.concatenate(pieces)), tuple(stretches))


def _lane_line(street: StreetLayout, lane: int, *, along: bool) -> NDArray[np.float64]:
    return street.travelled(street.lane(lane, along=along).centre_t, along=along)[:, :2]


def _link(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    out, into = before[-1] - before[-2], after[1] - after[0]
    return curves.link(before[-1], out / np.linalg.norm(out), after[0], into / np.linalg.norm(into))


def ego_of(road: Road) -> Vehicle:
    """The ego's place on a road."""
    return next(
        place
        for place in road.agents.values()
        if isinstance(place, Vehicle) and place.role == "ego"
    )


def ego_way(ways: RoadWays, ego: Vehicle) -> tuple[Way, float, float]:
    """The ego's way, and the stations of its spawn and its destination."""
    street = ways.streets[ego.route[0]]
    along = ways.along(ego.route, 0)
    gaps = {
        band.number: _lateral_gap(street, band, ego)
        for band in street.side(along=along)
        if band.kind is StripKind.LANE
    }
    lane = min(gaps, key=lambda number: gaps[number])
    way = ways.route(ego.route, lane)
    return way, way.nearest(ego.spawn_m), way.nearest(ego.destination_m)


def _lateral_gap(street: StreetLayout, band: Band, ego: Vehicle) -> float:
    line = street.line(band.centre_t)[:, :2]
    fine = curves.resampled(line, max(int(curves.length(line)), 2))
    return float(np.linalg.norm(fine - np.array(ego.spawn_m), axis=1).min())
