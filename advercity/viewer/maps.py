"""Roads and receivers' fixes on a map of the Earth."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from advercity_dsl import Road
from numpy.typing import NDArray

from advercity.sensors.geodesy import Geodetic, geodetic_from_enu
from advercity.viewer.shapes import Colour
from advercity.world.scene import Lane

AGENT_COLOURS: tuple[Colour, ...] = ((0, 200, 120), (255, 170, 0), (90, 140, 255), (230, 90, 200))
ROAD_COLOUR = (120, 120, 120)
FIX_PX, TRACK_PX, ROAD_PX = 6.0, 2.0, 1.0
SPAN_M = 1000.0


@dataclass
class Track:
    """Where a vehicle has been: places (x, y, z) in the world, and fixes in degrees."""

    colour: Colour
    driven: list[tuple[float, float, float]] = field(default_factory=list)
    fixes: list[tuple[float, float]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class LocalMap:
    """Latitude and longitude around a road's origin, to a decimetre within a kilometre.

    Attributes:
        origin_deg: (2,) latitude and longitude.
        degrees_per_m: (2, 2) of latitude and longitude by metre to the east and to the north.
    """

    origin_deg: NDArray[np.float64]
    degrees_per_m: NDArray[np.float64]

    @staticmethod
    def of(road: Road) -> "LocalMap":
        """The map around a road."""
        origin = Geodetic(road.origin_lat_deg, road.origin_lon_deg)
        middle, east, north = (
            np.array([place.latitude_deg, place.longitude_deg])
            for place in (
                geodetic_from_enu(point, origin)
                for point in ((0.0, 0.0, 0.0), (SPAN_M, 0.0, 0.0), (0.0, SPAN_M, 0.0))
            )
        )
        return LocalMap(middle, np.column_stack([east - middle, north - middle]) / SPAN_M)

    def degrees(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Latitudes and longitudes (n, 2) of points (n, 3) of the world."""
        return self.origin_deg + points[:, :2] @ self.degrees_per_m.T

    def road(self, lanes: Sequence[Lane]) -> rr.GeoLineStrings:
        """Both borders of every lane; without the map's tiles there is still the road."""
        return rr.GeoLineStrings(
            lat_lon=[self.degrees(side) for lane in lanes for side in (lane.left, lane.right)],
            colors=ROAD_COLOUR,
            radii=rr.Radius.ui_points(ROAD_PX),
        )


def colour_of(index: int) -> Colour:
    """What a viewpoint is drawn in, in the scene and on the map."""
    return AGENT_COLOURS[index % len(AGENT_COLOURS)]


def map_point(fix: tuple[float, float], colour: Colour) -> rr.GeoPoints:
    """Where a receiver says that it is."""
    return rr.GeoPoints(lat_lon=[fix], colors=colour, radii=rr.Radius.ui_points(FIX_PX))


def map_line(fixes: Sequence[tuple[float, float]], colour: Colour) -> rr.GeoLineStrings:
    """Where it has said to be."""
    strips = [fixes] if len(fixes) > 1 else []
    return rr.GeoLineStrings(lat_lon=strips, colors=colour, radii=rr.Radius.ui_points(TRACK_PX))
