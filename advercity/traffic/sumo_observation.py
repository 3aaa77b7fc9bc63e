"""What SUMO tells of everybody, asked for no more than the record needs and kept field by field.

A call for each field of each actor at each tick takes longer than SUMO's own step. A body is drawn
by its front, so a vehicle's angle and slope and a person's speed count at their first tick alone,
and a vehicle's acceleration is the difference of its speeds. What is not asked for is NaN.
"""

from array import array
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.frames import FRONT_DTYPE, Lamp, Signal
from advercity.roads.sumo_network import read_signal_groups
from advercity.traffic import sumo_api

INDICATOR_LAMPS = np.array([0, Lamp.RIGHT, Lamp.LEFT, Lamp.RIGHT | Lamp.LEFT], dtype=np.uint8)
"""By SUMO's two lowest bits of a vehicle's signals."""
_INDICATOR_BITS = 3


class ActorPresence:
    """Who is there.

    Attributes:
        ids: SUMO's.
        id_set: The same, to look one up.
        numbers: The same as numbers.
        new_ids: Those of the names who have just come.
    """

    def __init__(self, came: sumo_api.IdQuery, left: sumo_api.IdQuery) -> None:
        """Nobody, before SUMO is asked who came and who left."""
        self.ids: tuple[str, ...] = ()
        self.id_set: frozenset[str] = frozenset()
        self.numbers = array("i")
        self.new_ids: tuple[str, ...] = ()
        self._came = came
        self._left = left

    def update(self) -> bool:
        """Look who is there after a step; whether that has changed."""
        self.new_ids, left = self._came(), self._left()
        if not (self.new_ids or left):
            return False
        self.ids = (*(name for name in self.ids if name not in left), *self.new_ids)
        self.id_set = frozenset(self.ids)
        self.numbers = array("i", map(int, self.ids))
        return True


class VehicleLog:
    """Fronts of vehicles, tick by tick."""

    def __init__(self, there: ActorPresence, turning: Iterable[str]) -> None:
        """Ask after those who are there, and after the angles of those in `turning` always."""
        self._there = there
        self._turning = frozenset(turning)
        self._places = _PositionLog(there, sumo_api.vehicle_position)
        self._speeds: list[float] = []
        self._signals: list[int] = []
        self._turned: list[tuple[int, float, float]] = []

    def record(self) -> list[float]:
        """Note a tick; speeds in m/s."""
        names, begin = self._there.ids, len(self._speeds)
        for name in (self._turning & self._there.id_set).union(self._there.new_ids):
            row = begin + names.index(name)
            self._turned.append((row, sumo_api.vehicle_angle(name), sumo_api.vehicle_slope(name)))
        self._places.record()
        self._speeds += map(sumo_api.vehicle_speed, names)
        self._signals += map(sumo_api.vehicle_signals, names)
        return self._speeds[begin:]

    def build_fronts(self, tick_s: float) -> dict[int, NDArray[np.void]]:
        """Rows of `FRONT` by vehicle."""
        rows = self._places.build_fronts()
        rows["yaw"] = rows["slope"] = np.nan
        at, angles, slopes = np.array(self._turned).reshape(-1, 3).T
        rows["yaw"][at.astype(int)] = _to_yaw(angles)
        rows["slope"][at.astype(int)] = np.radians(slopes)
        rows["speed"] = self._speeds
        rows["lamps"] = INDICATOR_LAMPS[np.array(self._signals) & _INDICATOR_BITS]
        rows, begins = _sort_by_actor(rows)
        rows["acceleration"][1:] = np.diff(rows["speed"]) / tick_s
        rows["acceleration"][begins] = 0.0
        return _split_tracks(rows, begins)


class PedestrianLog:
    """Fronts of people on foot, tick by tick."""

    def __init__(self, there: ActorPresence) -> None:
        """Ask after those who are there."""
        self._there = there
        self._places = _PositionLog(there, sumo_api.person_position)
        self._angles: list[float] = []
        self._speeds: list[tuple[int, float]] = []

    def record(self) -> None:
        """Note a tick."""
        names, begin = self._there.ids, len(self._angles)
        for name in self._there.new_ids:
            self._speeds.append((begin + names.index(name), sumo_api.person_speed(name)))
        self._places.record()
        self._angles += map(sumo_api.person_angle, names)

    def build_fronts(self) -> dict[int, NDArray[np.void]]:
        """Rows of `FRONT` by person."""
        rows = self._places.build_fronts()
        rows["yaw"], rows["speed"] = _to_yaw(np.array(self._angles)), np.nan
        at, speeds = np.array(self._speeds).reshape(-1, 2).T
        rows["speed"][at.astype(int)] = speeds
        return _split_tracks(*_sort_by_actor(rows))


class SignalLog:
    """What signals show, tick by tick.

    Attributes:
        ids: Ids of `SignalLamp`.
    """

    def __init__(self, network: Path) -> None:
        """The signals of a SUMO network."""
        groups = read_signal_groups(network)
        self.ids = tuple(groups)
        self._lights = list({light: None for links in groups.values() for light, _ in links})
        self._links = [
            [(self._lights.index(light), link) for light, link in links]
            for links in groups.values()
        ]
        self._states: list[tuple[str, ...]] = []

    def record(self) -> None:
        """Note a tick."""
        self._states.append(tuple(map(sumo_api.traffic_light_state, self._lights)))

    def build_states(self) -> NDArray[np.uint8]:
        """(ticks, signals) of `Signal`."""
        meant = {
            states: [_combine_links(states, links) for links in self._links]
            for states in {*self._states}
        }
        rows = np.array([meant[states] for states in self._states], dtype=np.uint8)
        return rows.reshape(len(rows), len(self.ids))


def _combine_links(states: Sequence[str], links: Iterable[tuple[int, int]]) -> Signal:
    """What an approach's light shows: the most that any of its links is given."""
    meaning = {"g": Signal.GREEN, "y": Signal.YELLOW}
    return max(meaning.get(states[light][link].lower(), Signal.RED) for light, link in links)


class _PositionLog:
    """Where those who are there are, tick by tick."""

    def __init__(self, there: ActorPresence, place_of: Callable[[str], sumo_api.Position]) -> None:
        self._there = there
        self._place_of = place_of
        self._counts: list[int] = []
        self._numbers = array("i")
        self._axes: list[float] = []

    def record(self) -> None:
        self._counts.append(len(self._there.ids))
        self._numbers += self._there.numbers
        self._axes += chain.from_iterable(map(self._place_of, self._there.ids))

    def build_fronts(self) -> NDArray[np.void]:
        rows = np.zeros(len(self._numbers), dtype=FRONT_DTYPE)
        rows["tick"] = np.repeat(np.arange(len(self._counts)), self._counts)
        rows["id"] = self._numbers
        rows["x"], rows["y"], rows["z"] = np.array(self._axes).reshape(-1, 3).T
        return rows


def _sort_by_actor(rows: NDArray[np.void]) -> tuple[NDArray[np.void], NDArray[np.intp]]:
    """The rows with those of each actor together, and where each begins."""
    rows = rows[np.argsort(rows["id"], kind="stable")]
    return rows, np.flatnonzero(np.diff(rows["id"], prepend=-1))


def _split_tracks(rows: NDArray[np.void], begins: NDArray[np.intp]) -> dict[int, NDArray[np.void]]:
    ids = rows["id"][begins].tolist()
    return dict(zip(ids, np.split(rows, begins)[1:], strict=True))


def _to_yaw(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """SUMO's degrees clockwise from north as radians counter-clockwise from east."""
    return np.pi / 2 - np.radians(angles)
