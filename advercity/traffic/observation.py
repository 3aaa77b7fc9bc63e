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

from advercity.traffic import calls
from advercity.traffic.bumpers import FRONT
from advercity.traffic.trace import Lamp, Signal
from advercity.world.network import signal_groups

LAMPS = np.array([0, Lamp.RIGHT, Lamp.LEFT, Lamp.RIGHT | Lamp.LEFT], dtype=np.uint8)
"""By SUMO's two lowest bits of a vehicle's signals."""
_BLINKERS = 3


class Presence:
    """Who is there.

    Attributes:
        names: SUMO's.
        known: The same, to look one up.
        numbers: The same as numbers.
        new: Those of the names who have just come.
    """

    def __init__(self, came: calls.Names, left: calls.Names) -> None:
        """Nobody, before SUMO is asked who came and who left."""
        self.names: tuple[str, ...] = ()
        self.known: frozenset[str] = frozenset()
        self.numbers = array("i")
        self.new: tuple[str, ...] = ()
        self._came = came
        self._left = left

    def look(self) -> bool:
        """Look who is there after a step; whether that has changed."""
        self.new, left = self._came(), self._left()
        if not (self.new or left):
            return False
        self.names = (*(name for name in self.names if name not in left), *self.new)
        self.known = frozenset(self.names)
        self.numbers = array("i", map(int, self.names))
        return True


class VehicleLog:
    """Fronts of vehicles, tick by tick."""

    def __init__(self, there: Presence, turning: Iterable[str]) -> None:
        """Ask after those who are there, and after the angles of those in `turning` always."""
        self._there = there
        self._turning = frozenset(turning)
        self._places = _Places(there, calls.vehicle_place)
        self._speeds: list[float] = []
        self._signals: list[int] = []
        self._turned: list[tuple[int, float, float]] = []

    def note(self) -> list[float]:
        """Note a tick; speeds in m/s."""
        names, begin = self._there.names, len(self._speeds)
        for name in (self._turning & self._there.known).union(self._there.new):
            row = begin + names.index(name)
            self._turned.append((row, calls.vehicle_angle(name), calls.vehicle_slope(name)))
        self._places.note()
        self._speeds += map(calls.vehicle_speed, names)
        self._signals += map(calls.vehicle_signals, names)
        return self._speeds[begin:]

    def fronts(self, tick_s: float) -> dict[int, NDArray[np.void]]:
        """Rows of `FRONT` by vehicle."""
        rows = self._places.fronts()
        rows["yaw"] = rows["slope"] = np.nan
        at, angles, slopes = np.array(self._turned).reshape(-1, 3).T
        rows["yaw"][at.astype(int)] = _yaw(angles)
        rows["slope"][at.astype(int)] = np.radians(slopes)
        rows["speed"] = self._speeds
        rows["lamps"] = LAMPS[np.array(self._signals) & _BLINKERS]
        rows, begins = _by_actor(rows)
        rows["acceleration"][1:] = np.diff(rows["speed"]) / tick_s
        rows["acceleration"][begins] = 0.0
        return _tracks(rows, begins)


class PersonLog:
    """Fronts of people on foot, tick by tick."""

    def __init__(self, there: Presence) -> None:
        """Ask after those who are there."""
        self._there = there
        self._places = _Places(there, calls.person_place)
        self._angles: list[float] = []
        self._speeds: list[tuple[int, float]] = []

    def note(self) -> None:
        """Note a tick."""
        names, begin = self._there.names, len(self._angles)
        for name in self._there.new:
            self._speeds.append((begin + names.index(name), calls.person_speed(name)))
        self._places.note()
        self._angles += map(calls.person_angle, names)

    def fronts(self) -> dict[int, NDArray[np.void]]:
        """Rows of `FRONT` by person."""
        rows = self._places.fronts()
        rows["yaw"], rows["speed"] = _yaw(np.array(self._angles)), np.nan
        at, speeds = np.array(self._speeds).reshape(-1, 2).T
        rows["speed"][at.astype(int)] = speeds
        return _tracks(*_by_actor(rows))


class SignalLog:
    """What signals show, tick by tick.

    Attributes:
        ids: Ids of `SignalLamp`.
    """

    def __init__(self, network: Path) -> None:
        """The signals of a SUMO network."""
        groups = signal_groups(network)
        self.ids = tuple(groups)
        self._lights = list({light: None for links in groups.values() for light, _ in links})
        self._links = [
            [(self._lights.index(light), link) for light, link in links]
            for links in groups.values()
        ]
        self._states: list[tuple[str, ...]] = []

    def note(self) -> None:
        """Note a tick."""
        self._states.append(tuple(map(calls.light_state, self._lights)))

    def shown(self) -> NDArray[np.uint8]:
        """(ticks, signals) of `Signal`."""
        meant = {
            states: [_shown(states, links) for links in self._links] for states in {*self._states}
        }
        rows = np.array([meant[states] for states in self._states], dtype=np.uint8)
        return rows.reshape(len(rows), len(self.ids))


def _shown(states: Sequence[str], links: Iterable[tuple[int, int]]) -> Signal:
    """What an approach's light shows: the most that any of its links is given."""
    meaning = {"g": Signal.GREEN, "y": Signal.YELLOW}
    return max(meaning.get(states[light][link].lower(), Signal.RED) for light, link in links)


class _Places:
    """Where those who are there are, tick by tick."""

    def __init__(self, there: Presence, place_of: Callable[[str], calls.Place]) -> None:
        self._there = there
        self._place_of = place_of
        self._counts: list[int] = []
        self._numbers = array("i")
        self._axes: list[float] = []

    def note(self) -> None:
        self._counts.append(len(self._there.names))
        self._numbers += self._there.numbers
        self._axes += chain.from_iterable(map(self._place_of, self._there.names))

    def fronts(self) -> NDArray[np.void]:
        rows = np.zeros(len(self._numbers), dtype=FRONT)
        rows["tick"] = np.repeat(np.arange(len(self._counts)), self._counts)
        rows["id"] = self._numbers
        rows["x"], rows["y"], rows["z"] = np.array(self._axes).reshape(-1, 3).T
        return rows


def _by_actor(rows: NDArray[np.void]) -> tuple[NDArray[np.void], NDArray[np.intp]]:
    """The rows with those of each actor together, and where each begins."""
    rows = rows[np.argsort(rows["id"], kind="stable")]
    return rows, np.flatnonzero(np.diff(rows["id"], prepend=-1))


def _tracks(rows: NDArray[np.void], begins: NDArray[np.intp]) -> dict[int, NDArray[np.void]]:
    ids = rows["id"][begins].tolist()
    return dict(zip(ids, np.split(rows, begins)[1:], strict=True))


def _yaw(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """SUMO's degrees clockwise from north as radians counter-clockwise from east."""
    return np.pi / 2 - np.radians(angles)
