"""How fast everybody may go where they are, all vehicles at once."""

from collections.abc import Callable, Iterable, Sequence
from math import inf, nan

import numpy as np
from numpy.typing import NDArray

from advercity.traffic.bends import STEP_M, STRAIGHT_M_S, Pace

Where = Callable[[int], tuple[str, float]]
"""Asks for the edge that a vehicle is on and its position there."""
_PLACE = np.dtype(
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


class Pacing:
    """Keeps vehicles, counted from 0, to the pace of their routes.

    Whoever stays on an edge moves by their speed and need not be asked where they are.
    """

    def __init__(self, paces: Sequence[Pace], tops_m_s: Sequence[float]) -> None:
        """Vehicles by their paces and how fast they ever go; none is there yet."""
        tables = [[STRAIGHT_M_S, STRAIGHT_M_S], *(pace.speeds_m_s for pace in paces)]
        self._paces = paces
        self._sizes = [len(table) for table in tables]
        self._begins = np.cumsum([0, *self._sizes])
        self._speeds_m_s = np.concatenate(tables)
        self._rises_m_s = np.diff(self._speeds_m_s)
        self._all = np.zeros(len(paces), dtype=_PLACE)
        self._all["length_m"], self._all["told_m_s"] = -inf, nan
        self._all["top_m_s"] = tops_m_s
        self._there = np.array([], dtype=np.intp)
        self._here = self._all[self._there]

    def meet(self, there: Sequence[int]) -> None:
        """Pace these vehicles from now on."""
        self._all[self._there] = self._here
        self._there = np.array(there, dtype=np.intp)
        self._here = self._all[self._there]

    def news(self, moved_m: NDArray[np.float64], where: Where) -> Iterable[tuple[int, float]]:
        """Who of those there has to be told another top speed, and which.

        Args:
            moved_m: How far they have come (n,) since the last call.
            where: Asked where it must be.
        """
        here = self._here
        position_m = here["position_m"]
        position_m += moved_m
        for row in (position_m >= here["length_m"]).nonzero()[0].tolist():
            vehicle = int(self._there[row])
            self._place(here[row], vehicle, *where(vehicle))
        sample = np.minimum((here["begin_m"] + position_m) / STEP_M, here["last"])
        at = sample.astype(np.intp)
        share = sample - at
        at += here["table"]
        limits_m_s = self._speeds_m_s.take(at) + share * self._rises_m_s.take(at)
        tops_m_s = np.minimum(here["top_m_s"], limits_m_s)
        news = (tops_m_s != here["told_m_s"]).nonzero()[0]
        here["told_m_s"] = tops_m_s
        return zip(self._there[news].tolist(), tops_m_s[news].tolist(), strict=True)

    def _place(self, place: np.void, vehicle: int, edge: str, position_m: float) -> None:
        """Put a vehicle on an edge; there is no limit on edges that its route does not have."""
        pace = self._paces[vehicle]
        table = vehicle + 1 if edge in pace.begins_m else 0
        place["position_m"] = position_m
        place["length_m"] = pace.lengths_m.get(edge, -inf)
        place["begin_m"] = pace.begins_m.get(edge, 0.0)
        place["table"], place["last"] = self._begins[table], self._sizes[table] - 1.001
