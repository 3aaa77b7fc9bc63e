"""State the weather of datasets in quantities independent of how it was written."""

import math

from advercity_dsl import Model, Weather
from advercity_dsl.base import is_empty
from pydantic import ConfigDict, Field

from advercity.physics.extinction import compute_extinction
from advercity.physics.weather_parts.part import iterate_parts


class WeatherTruth(Model):
    """The weather of a frame in physical quantities.

    `mor_m` is the meteorological optical range of haze, fog, precipitation and dust together; None
    in perfectly clear air. Parts of other distributions add their own quantities.
    """

    model_config = ConfigDict(extra="allow")

    id: str
    time: str
    mor_m: float | None
    rain_mm_h: float
    snow_mm_h: float
    wind_m_s: float
    wind_from_deg: float
    sun_elevation_deg: float
    sun_azimuth_deg: float
    wetness: float
    puddle_coverage: float
    temperature_c: float
    hail_mm_h: float = Field(default=0.0, exclude_if=is_empty)
    ice_mm: float = Field(default=0.0, exclude_if=is_empty)

    @staticmethod
    def from_weather(weather: Weather) -> "WeatherTruth":
        """Compute the quantities of an authored weather."""
        mor_m = compute_extinction(weather).mor_m
        return WeatherTruth(
            id=weather.id,
            time=weather.time,
            mor_m=round(mor_m, 6) if math.isfinite(mor_m) else None,
            wind_m_s=weather.wind.speed_m_s,
            wind_from_deg=weather.wind.from_deg,
            sun_elevation_deg=weather.sun.elevation_deg,
            sun_azimuth_deg=weather.sun.azimuth_deg,
            wetness=weather.surface.wetness,
            puddle_coverage=weather.surface.puddle_coverage,
            temperature_c=weather.temperature_c,
            ice_mm=weather.surface.ice_mm,
            **{
                name: value
                for physics, part in iterate_parts(weather)
                for name, value in physics.list_quantities(part).items()
            },
        )
