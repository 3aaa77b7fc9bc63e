"""How fast a route may be driven: slower in bends, braking in time before them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import inf

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from advercity.traffic.demand import Ride
from advercity.traffic.lanes import Lane, LaneGraph

LATERAL_ACCELERATION_M_S2 = 3.5
"""Brisk but comfortable; the original's planner allowed 5."""
BRAKING_M_S2 = 2.0
"""How hard a driver slows down towards a bend."""
STEP_M = 1.0
CHORD_M = 4.0
"""Curvature is taken from three points this far apart, so that corners of polylines vanish."""
STEADY_M = 6.0
"""Within this distance drivers keep to the lowest speed."""
STRAIGHT_M_S = 50.0


@dataclass(frozen=True, eq=False)
class Pace:
    """Highest speed along a route.

    Attributes:
        begins_m: Where every edge begins along the route, those inside junctions included.
        lengths_m: How long the shortest lane of each of those edges is.
        speeds_m_s: Highest speed every `STEP_M`.
    """

    begins_m: dict[str, float]
    lengths_m: dict[str, float]
    speeds_m_s: list[float]

    @staticmethod
    def of(ride: Ride, graph: LaneGraph, most_m_s2: float = inf) -> "Pace":
        """The pace of a ride's route, with no more than `most_m_s2` sideways or in braking."""
        return _pace(ride.edges, ride.lane, graph, most_m_s2)


@lru_cache(maxsize=1024)
def _pace(edges: tuple[str, ...], lane: int, graph: LaneGraph, most_m_s2: float) -> Pace:
    """Kept, since many drive one way and rehearsals differ in few of them."""
    lanes = list(_lanes(edges, graph.lanes[f"{edges[0]}_{lane}"], graph))
    begins = np.cumsum([0.0, *(lane.length_m for lane in lanes)])
    stations = np.concatenate(
        [lane.stations_m + begin for lane, begin in zip(lanes, begins, strict=False)]
    )
    points = np.concatenate([lane.shape[:, :2] for lane in lanes])
    samples = np.arange(0.0, begins[-1] + STEP_M, STEP_M)
    path = np.column_stack([np.interp(samples, stations, axis) for axis in points.T])
    lateral = min(LATERAL_ACCELERATION_M_S2, most_m_s2)
    limit = np.sqrt(lateral / np.maximum(_curvature(path), 1e-9))
    return Pace(
        begins_m={lane.edge: float(at) for lane, at in zip(lanes, begins, strict=False)},
        lengths_m={lane.edge: graph.shortest_m[lane.edge] for lane in lanes},
        speeds_m_s=_braked(
            _steady(np.minimum(limit, STRAIGHT_M_S)), min(BRAKING_M_S2, most_m_s2)
        ).tolist(),
    )


def lanes_of(ride: Ride, graph: LaneGraph) -> list[Lane]:
    """The lanes of a ride's route, inside junctions too."""
    first = graph.lanes[f"{ride.edges[0]}_{ride.lane}"]
    return list(_lanes(ride.edges, first, graph))


def _lanes(edges: Iterable[str], lane: Lane, graph: LaneGraph) -> Iterator[Lane]:
    """Lanes of a route, inside junctions too."""
    yield lane
    for edge in tuple(edges)[1:]:
        joint = graph.joint(lane, edge)
        yield from graph.inside(joint)
        lane = graph.lanes[joint.target]
        yield lane


def _curvature(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Curvature (n,) in 1/m of a path (n, 2): that of the circle through three of its points."""
    reach = round(CHORD_M / STEP_M)
    curvature = np.zeros(len(path))
    if len(path) <= 2 * reach:
        return curvature
    before, here, after = path[: -2 * reach], path[reach:-reach], path[2 * reach :]
    first, second, chord = here - before, after - here, after - before
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    sides = np.prod([np.linalg.norm(side, axis=1) for side in (first, second, chord)], axis=0)
    curvature[reach:-reach] = 2 * np.abs(area) / np.maximum(sides, 1e-9)
    return curvature


def _steady(limit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds (n,) below the limit everywhere that do not follow its every tremor."""
    reach = round(STEADY_M / STEP_M)
    lowest = _windows(limit, reach).min(axis=1)
    return _windows(lowest, reach).mean(axis=1)


def _windows(values: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """What lies within `reach` samples of each of the values (n,): (n, 2 reach + 1)."""
    return sliding_window_view(np.pad(values, reach, mode="edge"), 2 * reach + 1)


def _braked(limit: NDArray[np.float64], braking_m_s2: float) -> NDArray[np.float64]:
    """The highest speeds (n,) from which every lower limit further on can be met by braking."""
    stations = np.arange(len(limit)) * STEP_M
    energy = limit**2 + 2 * braking_m_s2 * stations
    lowest_ahead = np.minimum.accumulate(energy[::-1])[::-1]
    return np.sqrt(lowest_ahead - 2 * braking_m_s2 * stations)
