"""From authored weather to what light does: extinction, airlight, sky, sun and ground light.

All photometric: cd/m², lx, 1/m. Colours are linear sRGB factors with luminance 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Atmosphere:
    """The physical state that every sensor sees.

    Attributes:
        extinction_550nm: Total extinction in the visible, 1/m.
        extinction_905nm: Total extinction at the LiDAR's wavelength, 1/m.
        sun_direction: Unit vector (3,) towards the sun.
        sun_lx: Direct normal illuminance by the sun, already dimmed by fog above.
        sun_colour: Colour of direct sunlight.
        sky_lx: Diffuse horizontal illuminance: what the upper half of `sky` gives.
        sky: (6, n, n, 3) float32 cubemap of luminance in cd/m² without the sun's disc, faces
            +x -x +y -y +z -z of the world; below the horizon it is the light of the ground.
            Face axes (column right, row down): +x: (-y, -z), -x: (+y, -z), +y: (+x, -z),
            -y: (-x, -z), +z: (-y, +x), -z: (-y, -x).
        airlight: (6, m, m, 4) float32 cubemap, laid out as `sky`, of the light that air near the
            ground sends to the eye for each share that it takes away: three colours in cd/m², and
            by what share this grows along an endless ray, where air is brighter higher up.
        street_lx: Mean illuminance by street lamps, 0 by day.
        wetness: 0 dry to 1 soaked.
        puddle_coverage: Share of the carriageway under standing water.
        night: Whether lamps light the scene.
        rain_mm_h: Rate of the falling rain, which ripples puddles.
        snow_depth_m: Of the snow that lies in the open.
        road_snow_cover: Share of the carriageway under snow.
        rut_snow_cover: Share of its wheel ruts under snow.
    """

    extinction_550nm: float
    extinction_905nm: float
    sun_direction: NDArray[np.float64]
    sun_lx: float
    sun_colour: Colour
    sky_lx: float
    sky: NDArray[np.float32]
    airlight: NDArray[np.float32]
    street_lx: float
    wetness: float
    puddle_coverage: float
    night: bool
    rain_mm_h: float = 0.0
    snow_depth_m: float = 0.0
    road_snow_cover: float = 0.0
    rut_snow_cover: float = 0.0

    @property
    def mor_m(self) -> float:
        """Meteorological optical range of the whole atmosphere; inf in a vacuum."""
        return math.log(20.0) / self.extinction_550nm if self.extinction_550nm else math.inf

    @property
    def ground_lx(self) -> float:
        """Illuminance of level ground in the open by sun and sky."""
        return self.sky_lx + self.sun_lx * max(0.0, float(self.sun_direction[2]))

    @property
    def airlight_low(self) -> Colour:
        """Airlight in cd/m² looking level, on the mean of all sides."""
        middle = self.airlight.shape[1] // 2
        level = self.airlight[:4, middle - 1 : middle + 1, :, :3]
        red, green, blue = level.mean(axis=(0, 1, 2), dtype=np.float64)
        return float(red), float(green), float(blue)

    @property
    def airlight_high(self) -> Colour:
        """Airlight in cd/m² along an endless ray to the zenith."""
        middle = self.airlight.shape[1] // 2
        around = slice(middle - 1, middle + 1)
        zenith = self.airlight[4, around, around].reshape(-1, 4)
        red, green, blue = (zenith[:, :3] * (1.0 + zenith[:, 3:])).mean(axis=0, dtype=np.float64)
        return float(red), float(green), float(blue)
