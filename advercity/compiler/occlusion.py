"""From where the ego sees whoever comes out behind parked cars."""

from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from advercity import curves
from advercity.compiler.nominal import Pace
from advercity.compiler.ways import Way

LOOKS_BACK_S = 6.0
TICK_S = 0.05


def seen_from_m(
    way: Way,
    pace: Pace,
    station_m: float,
    path: NDArray[np.float64],
    speed_m_s: float,
    obstructions: Iterable[shapely.Geometry],
) -> float | None:
    """How far before the conflict point the ego's middle is when the actor comes into sight.

    Both come as if to meet there: the ego at the pace of its way, the actor at its speed. A sight
    line from middle to middle counts, and that cars are higher than it: what is seen over a roof or
    through windows is not. Cars in ordinary parking places are left out.

    Args:
        way: Of the ego.
        pace: Of the ego.
        station_m: Of the conflict point on the way.
        path: Points (n, 2) of the actor's way.
        speed_m_s: Of the actor.
        obstructions: Outlines of parked cars.

    Returns:
        None if nothing ever hides the actor.
    """
    times_s = np.arange(0.0, LOOKS_BACK_S, TICK_S)
    stations = [pace.station(pace.time(station_m) - time_s) for time_s in times_s]
    eyes = np.array([way.at(station) for station in stations])
    along = curves.stations(path)
    meets_m = shapely.LineString(path).project(shapely.Point(way.at(station_m)))
    walked = np.maximum(meets_m - speed_m_s * times_s, 0.0)
    actor = np.stack([np.interp(walked, along, axis) for axis in path.T], axis=-1)
    sight = shapely.linestrings(np.stack([eyes, actor], axis=1))
    hidden = np.flatnonzero(shapely.intersects(sight, shapely.union_all(list(obstructions))))
    return float(station_m - stations[hidden[0]]) if len(hidden) > 0 else None


def outline(ends: NDArray[np.float64], width_m: float) -> shapely.Geometry:
    """Of a car between the middles (2, 2) of its rear and its front."""
    return shapely.LineString(ends).buffer(width_m / 2, cap_style="flat")
