"""How fast a route may be driven: slower in bends, braking in time before them.

How fast everybody may go where they are, all vehicles at once.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf, nan

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from advercity.roads.lane_graph import LaneGraph, SumoLane
from advercity.traffic.demand import VehicleTrip

LATERAL_ACCELERATION_M_S2 = 3.5
"""Brisk but comfortable; the original's planner allowed 5."""
BRAKING_M_S2 = 2.0
"""How hard a driver slows down towards a bend."""
PROFILE_STEP_M = 1.0
CURVATURE_CHORD_M = 4.0
"""Curvature is taken from three points this far apart, so that corners of polylines vanish."""
SMOOTHING_WINDOW_M = 6.0
"""Within this distance drivers keep to the lowest speed."""
MAX_PROFILE_SPEED_M_S = 50.0


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Highest speed along a route.

    Attributes:
        edge_starts_m: Where every edge begins along the route, those inside junctions included.
        edge_lengths_m: How long the shortest lane of each of those edges is.
        speeds_m_s: Highest speed every `STEP_M`.
    """

    edge_starts_m: dict[str, float]
    edge_lengths_m: dict[str, float]
    speeds_m_s: list[float]

    @staticmethod
    def from_trip(ride: VehicleTrip, graph: LaneGraph, max_m_s2: float = inf) -> "SpeedProfile":
        """The pace of a ride's route, with no more than `most_m_s2` sideways or in braking."""
        return _build_profile(ride.edges, ride.lane, graph, max_m_s2)


@lru_cache(maxsize=1024)
def _build_profile(
    edges: tuple[str, ...], lane: int, graph: LaneGraph, most_m_s2: float
) -> SpeedProfile:
    """Kept, since many drive one way and rehearsals differ in few of them."""
    lanes = list(_iterate_route_lanes(edges, graph.lanes[f"{edges[0]}_{lane}"], graph))
    begins = np.cumsum([0.0, *(lane.length_m for lane in lanes)])
    stations = np.concatenate(
        [lane.line.stations_m + begin for lane, begin in zip(lanes, begins, strict=False)]
    )
    points = np.concatenate([lane.shape[:, :2] for lane in lanes])
    samples = np.arange(0.0, begins[-1] + PROFILE_STEP_M, PROFILE_STEP_M)
    path = np.column_stack([np.interp(samples, stations, axis) for axis in points.T])
    lateral = min(LATERAL_ACCELERATION_M_S2, most_m_s2)
    limit = np.sqrt(lateral / np.maximum(_compute_curvature(path), 1e-9))
    return SpeedProfile(
        edge_starts_m={lane.edge: float(at) for lane, at in zip(lanes, begins, strict=False)},
        edge_lengths_m={lane.edge: graph.shortest_lane_m[lane.edge] for lane in lanes},
        speeds_m_s=_limit_by_braking(
            _smooth_limit(np.minimum(limit, MAX_PROFILE_SPEED_M_S)), min(BRAKING_M_S2, most_m_s2)
        ).tolist(),
    )


def list_route_lanes(ride: VehicleTrip, graph: LaneGraph) -> list[SumoLane]:
    """The lanes of a ride's route, inside junctions too."""
    first = graph.lanes[f"{ride.edges[0]}_{ride.lane}"]
    return list(_iterate_route_lanes(ride.edges, first, graph))


def _iterate_route_lanes(
    edges: Iterable[str], lane: SumoLane, graph: LaneGraph
) -> Iterator[SumoLane]:
    """Lanes of a route, inside junctions too."""
    yield lane
    for edge in tuple(edges)[1:]:
        joint = graph.find_connection(lane, edge)
        yield from graph.iterate_internal_lanes(joint)
        lane = graph.lanes[joint.target]
        yield lane


def _compute_curvature(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Curvature (n,) in 1/m of a path (n, 2): that of the circle through three of its points."""
    reach = round(CURVATURE_CHORD_M / PROFILE_STEP_M)
    curvature = np.zeros(len(path))
    if len(path) <= 2 * reach:
        return curvature
    before, here, after = path[: -2 * reach], path[reach:-reach], path[2 * reach :]
    first, second, chord = here - before, after - here, after - before
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    sides = np.prod([np.linalg.norm(side, axis=1) for side in (first, second, chord)], axis=0)
    curvature[reach:-reach] = 2 * np.abs(area) / np.maximum(sides, 1e-9)
    return curvature


def _smooth_limit(limit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds (n,) below the limit everywhere that do not follow its every tremor."""
    reach = round(SMOOTHING_WINDOW_M / PROFILE_STEP_M)
    lowest = _build_windows(limit, reach).min(axis=1)
    return _build_windows(lowest, reach).mean(axis=1)


def _build_windows(values: NDArray[np.float64], half_width: int) -> NDArray[np.float64]:
    """What lies within `reach` samples of each of the values (n,): (n, 2 reach + 1)."""
    return sliding_window_view(np.pad(values, half_width, mode="edge"), 2 * half_width + 1)


def _limit_by_braking(limit: NDArray[np.float64], braking_m_s2: float) -> NDArray[np.float64]:
    """The highest speeds (n,) from which every lower limit further on can be met by braking."""
    stations = np.arange(len(limit)) * PROFILE_STEP_M
    energy = limit**2 + 2 * braking_m_s2 * stations
    lowest_ahead = np.minimum.accumulate(energy[::-1])[::-1]
    return np.sqrt(lowest_ahead - 2 * braking_m_s2 * stations)


LocateVehicle = Callable[[int], tuple[str, float]]
"""Asks for the edge that a vehicle is on and its position there."""
_POSITION_DTYPE = np.dtype(
    [
        ("position_m", "<f8"),
        ("length_m", "<f8"),
        ("begin_m", "<f8"),
        ("table", "<i8"),
        ("last", "<f8"),
        ("top_m_s", "<f8"),
        ("told_m_s", "<f8"),
    ]
)
"""A vehicle on an edge: where it is on it, how long that is and where on the route it begins; where
its table of speeds begins and the last sample of it; how fast it ever goes and was told to go."""


class SpeedLimiter:
    """Keeps vehicles, counted from 0, to the pace of their routes.

    Whoever stays on an edge moves by their speed and need not be asked where they are.
    """

    def __init__(self, paces: Sequence[SpeedProfile], tops_m_s: Sequence[float]) -> None:
        """Vehicles by their paces and how fast they ever go; none is there yet."""
        tables = [
            [MAX_PROFILE_SPEED_M_S, MAX_PROFILE_SPEED_M_S],
            *(pace.speeds_m_s for pace in paces),
        ]
        self._paces = paces
        self._sizes = [len(table) for table in tables]
        self._begins = np.cumsum([0, *self._sizes])
        self._speeds_m_s = np.concatenate(tables)
        self._rises_m_s = np.diff(self._speeds_m_s)
        self._all = np.zeros(len(paces), dtype=_POSITION_DTYPE)
        self._all["length_m"], self._all["told_m_s"] = -inf, nan
        self._all["top_m_s"] = tops_m_s
        self._there = np.array([], dtype=np.intp)
        self._here = self._all[self._there]

    def set_present(self, vehicles: Sequence[int]) -> None:
        """Pace these vehicles from now on."""
        self._all[self._there] = self._here
        self._there = np.array(vehicles, dtype=np.intp)
        self._here = self._all[self._there]

    def update_limits(
        self, moved_m: NDArray[np.float64], locate: LocateVehicle
    ) -> Iterable[tuple[int, float]]:
        """Who of those there has to be told another top speed, and which.

        Args:
            moved_m: How far they have come (n,) since the last call.
            locate: Asked where it must be.
        """
        here = self._here
        position_m = here["position_m"]
        position_m += moved_m
        for row in (position_m >= here["length_m"]).nonzero()[0].tolist():
            vehicle = int(self._there[row])
            self._set_position(here[row], vehicle, *locate(vehicle))
        sample = np.minimum((here["begin_m"] + position_m) / PROFILE_STEP_M, here["last"])
        at = sample.astype(np.intp)
        share = sample - at
        at += here["table"]
        limits_m_s = self._speeds_m_s.take(at) + share * self._rises_m_s.take(at)
        tops_m_s = np.minimum(here["top_m_s"], limits_m_s)
        news = (tops_m_s != here["told_m_s"]).nonzero()[0]
        here["told_m_s"] = tops_m_s
        return zip(self._there[news].tolist(), tops_m_s[news].tolist(), strict=True)

    def _set_position(self, place: np.void, vehicle: int, edge: str, position_m: float) -> None:
        """Put a vehicle on an edge; there is no limit on edges that its route does not have."""
        pace = self._paces[vehicle]
        table = vehicle + 1 if edge in pace.edge_starts_m else 0
        place["position_m"] = position_m
        place["length_m"] = pace.edge_lengths_m.get(edge, -inf)
        place["begin_m"] = pace.edge_starts_m.get(edge, 0.0)
        place["table"], place["last"] = self._begins[table], self._sizes[table] - 1.001
