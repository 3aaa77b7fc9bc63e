"""Record SUMO at every tick: front bumpers, indicators and traffic lights."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import libsumo
import numpy as np
from numpy.typing import NDArray

from advercity.frames import FRONT_DTYPE, Lamp
from advercity.roads.network_file import read_signal_groups
from advercity.traffic.signal_states import combine_links

INDICATOR_LAMPS = np.array([0, Lamp.RIGHT, Lamp.LEFT, Lamp.RIGHT | Lamp.LEFT], dtype=np.uint8)
"""Lamps by the two lowest bits of SUMO's signals of a vehicle."""
_INDICATOR_BITS = 3
INDICATOR_PAUSE_S = 3.0
"""Maximum pause of an indicator: SUMO's vehicles stop indicating at the begin of a turn, until they
are near its end."""
_ROW_COLUMNS = ["tick", "id", "x", "y", "z", "yaw", "slope", "speed", "lamps"]


class ActorLog:
    """Fronts of all vehicles and pedestrians, tick by tick."""

    def __init__(self) -> None:
        """Create an empty log."""
        self._vehicles: list[tuple[float, ...]] = []
        self._seen = set[str]()
        self._pedestrians: list[tuple[float, ...]] = []

    def record_vehicles(self, tick: int, names: Sequence[str]) -> list[float]:
        """Record the vehicles of a tick and return their speeds in m/s.

        Slope counts at a vehicle's first tick only, since a body follows its own front later.
        """
        query, seen = libsumo.vehicle, self._seen
        rows = [
            (
                tick,
                int(name),
                *query.getPosition3D(name),
                query.getAngle(name),
                0.0 if name in seen else query.getSlope(name),
                query.getSpeed(name),
                query.getSignals(name) & _INDICATOR_BITS,
            )
            for name in names
        ]
        self._vehicles += rows
        seen.update(names)
        return [row[-2] for row in rows]

    def record_pedestrians(self, tick: int, names: Iterable[str]) -> None:
        """Record the people of a tick; SUMO gives them neither slope nor lamps."""
        query = libsumo.person
        self._pedestrians += [
            (
                tick,
                int(name),
                *query.getPosition3D(name),
                query.getAngle(name),
                0.0,
                query.getSpeed(name),
                0,
            )
            for name in names
        ]

    def build_fronts(self, tick_s: float) -> dict[int, NDArray[np.void]]:
        """Build `FRONT_DTYPE` rows, sorted by tick, by actor."""
        vehicles, people = _build_rows(self._vehicles), _build_rows(self._pedestrians)
        vehicles["lamps"] = INDICATOR_LAMPS[vehicles["lamps"]]
        tracks = _split_by_actor(vehicles)
        for track in tracks.values():
            # SUMO's own acceleration is this difference, so it need not be queried.
            track["acceleration"][1:] = np.diff(track["speed"]) / tick_s
            _bridge_pauses(track["lamps"], round(INDICATOR_PAUSE_S / tick_s))
        return tracks | _split_by_actor(people)


def _build_rows(records: Sequence[tuple[float, ...]]) -> NDArray[np.void]:
    rows = np.zeros(len(records), dtype=FRONT_DTYPE)
    table = np.array(records, dtype=np.float64).reshape(-1, len(_ROW_COLUMNS))
    for name, column in zip(_ROW_COLUMNS, table.T, strict=True):
        rows[name] = column
    # SUMO's angles are degrees clockwise from north, ours radians counter-clockwise from east.
    rows["yaw"] = np.pi / 2 - np.radians(rows["yaw"])
    rows["slope"] = np.radians(rows["slope"])
    return rows


def _bridge_pauses(lamps: NDArray[np.uint8], longest: int) -> None:
    """Switch on lamps in pauses of at most `longest` ticks, in place."""
    for before, after in pairwise(np.flatnonzero(lamps).tolist()):
        if after - before <= longest and lamps[before] == lamps[after]:
            lamps[before:after] = lamps[before]


def _split_by_actor(rows: NDArray[np.void]) -> dict[int, NDArray[np.void]]:
    rows = rows[np.argsort(rows["id"], kind="stable")]
    ids, begins = np.unique(rows["id"], return_index=True)
    return dict(zip(ids.tolist(), np.split(rows, begins)[1:], strict=True))


class SignalLog:
    """States of traffic lights, tick by tick.

    Attributes:
        ids: Ids of `SignalLamp`.
    """

    def __init__(self, network: Path) -> None:
        """Create an empty log of the signals of a SUMO network."""
        groups = read_signal_groups(network)
        self.ids = tuple(groups)
        self._lights = list({light: None for links in groups.values() for light, _ in links})
        self._links = [
            [(self._lights.index(light), link) for light, link in links]
            for links in groups.values()
        ]
        self._states: list[tuple[str, ...]] = []

    def record(self) -> None:
        """Record the states of all lights at a tick."""
        query = libsumo.trafficlight.getRedYellowGreenState
        self._states.append(tuple(query(light) for light in self._lights))

    def build_states(self) -> NDArray[np.uint8]:
        """Build an array (ticks, signals) of `Signal`."""
        # The lights have few different states in all, so each is decoded once.
        decoded = {
            states: [combine_links(states, links) for links in self._links]
            for states in {*self._states}
        }
        rows = np.array([decoded[states] for states in self._states], dtype=np.uint8)
        return rows.reshape(len(rows), len(self.ids))
