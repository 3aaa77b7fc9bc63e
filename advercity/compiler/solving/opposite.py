"""Those who come towards the ego in the lane beside its own."""

import numpy as np

from advercity.compiler.solving.case import Case, Placed
from advercity.compiler.solving.drive import EgoDrive

WAITS_S = 1.5
"""An oncoming actor starts so near that it can wait this long, to be in time."""
EARLIEST_S = 8.8
"""The ego meets nobody sooner; what leads to it is not lost in the warm-up."""
MIDDLE = (0.25, 0.62)
"""Shares of the ego's way between which it meets somebody oncoming."""
OFF_STREET_ENDS_M = 8.0
"""Nobody starts nearer to either end of a street."""


def opposite(case: Case, station_m: float) -> Placed:
    """From ahead in the other lane, so far off that both are at a station at once."""
    speed, gains = case.speed_m_s, case.drawn["acceleration_m_s2"]
    run = speed * (case.drive.pace.time(station_m) - speed / (2 * gains) - WAITS_S)
    return against(case.drive, station_m, run)


def against(drive: EgoDrive, station_m: float, run_m: float) -> Placed:
    """Against the ego in its lane, so far before a place on the ego's way."""
    route = tuple(reversed(drive.route))
    route = (*route, *_onward(drive, route[-1]))
    back = drive.ways.route(route)
    meets = back.nearest(drive.way.at(station_m))
    start = max(meets - run_m, OFF_STREET_ENDS_M)
    index, stretch = next(
        (number, item)
        for number, item in enumerate(back.stretches)
        if start < item.ends_m - OFF_STREET_ENDS_M
    )
    start = max(start, stretch.begins_m + OFF_STREET_ENDS_M)
    before_end = stretch.ends_m - start
    return Placed(station_m, meets - start, route=route[index:], start_m=before_end)


def straightest_m(drive: EgoDrive) -> float:
    """Station near the middle of the ego's way where the actor comes towards it straight.

    On a bend nobody could tell a drift from its velocity alone.
    """
    places = drive.start_m + np.linspace(*MIDDLE, 41) * (drive.end_m - drive.start_m)
    stations = [at for at in places.tolist() if drive.pace.time(at) >= EARLIEST_S]
    turns = [
        np.ptp(np.unwrap([drive.way.heading(s) for s in np.arange(at - 5.0, at + 32.0, 4.0)]))
        for at in stations
    ]
    return stations[int(np.argmin(np.round(turns, 2)))]


def _onward(drive: EgoDrive, street: str) -> tuple[str, ...]:
    """The street that the ego's first one is driven to, against the ego; none at the edge."""
    along = drive.ways.along(drive.route, 0)
    layout = drive.ways.streets[street]
    junction = layout.begins if along else layout.ends
    options = [
        item for item in drive.ways.movements.get(junction, ()) if item.from_street == street
    ]
    straightest = sorted(options, key=lambda item: abs(drive.ways.turn(item, junction)))
    return tuple(item.to_street for item in straightest[:1])
