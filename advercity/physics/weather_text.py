"""A weather in words, by the terms of weather services."""

import math
from collections.abc import Iterator

from advercity_dsl import Weather

from advercity.physics.extinction import mor_from_extinction, snow_extinction

FOG_TERMS = ((50, "dense fog"), (200, "thick fog"), (1000, "fog"))
"""Upper limit of visibility in metres for each term (WMO, UK roads)."""
DUST_TERMS = ((500, "severe dust storm"), (1000, "dust storm"))
RAIN_TERMS = (
    (2.5, "light rain"),
    (7.6, "moderate rain"),
    (50, "heavy rain"),
    (math.inf, "violent rain"),
)
"""Highest rate in mm/h for each term (American Meteorological Society)."""
SNOW_TERMS = ((500, "heavy snow"), (1000, "moderate snow"), (math.inf, "light snow"))
"""Upper limit of visibility in metres in the snow alone for each term."""
CLOUD_TERMS = ((0, "clear"), (2, "few clouds"), (4, "scattered clouds"), (7, "broken clouds"))
"""Highest cover in eighths for each term; 8 is overcast."""


def format_weather(weather: Weather) -> str:
    """Format a weather as `day: thick fog, overcast, wet road, -3 degC`.

    One that changes ends in how it is at last.
    """
    text = f"{weather.time}: {', '.join(_describe_parts(weather))}"
    if not weather.keyframes:
        return text
    last_s = weather.keyframes[-1].at_s
    return f"{text}; by {last_s:g} s {format_weather(weather.at(last_s))}"


def _describe_parts(weather: Weather) -> Iterator[str]:
    yield from _describe_airborne(weather)
    oktas = weather.sky.oktas
    yield next((name for highest, name in CLOUD_TERMS if oktas <= highest), "overcast")
    snow, surface = weather.snow, weather.surface
    if snow.road_coverage:
        yield f"{snow.road_coverage:.0%} of the road under snow"
    if surface.ice_mm:
        yield f"{surface.ice_mm:g} mm of ice"
    if surface.puddle_coverage:
        yield f"puddles on {surface.puddle_coverage:.0%} of the road"
    elif surface.wetness >= 0.3:
        yield "wet road"
    if weather.wind.speed_m_s >= 8:
        gusts = weather.wind.gust_factor * weather.wind.speed_m_s
        suffix = f" with gusts of {gusts:.0f} m/s" if weather.wind.gust_factor > 1 else ""
        yield f"wind of {weather.wind.speed_m_s:g} m/s{suffix}"
    yield f"{weather.temperature_c:g} degC"


def _describe_airborne(weather: Weather) -> Iterator[str]:
    fog, dust = weather.fog.mor_m, weather.dust.mor_m
    if fog is not None:
        yield next((name for below, name in FOG_TERMS if fog < below), "mist")
    if dust is not None:
        yield next((name for below, name in DUST_TERMS if dust < below), "dust in the air")
    if weather.rain.rate_mm_h:
        rain = next(name for highest, name in RAIN_TERMS if weather.rain.rate_mm_h <= highest)
        yield rain.replace("rain", "freezing rain") if weather.temperature_c < 0 else rain
    snow = weather.snow
    if snow.rate_mm_h:
        extinction_per_m = snow_extinction(snow.rate_mm_h, density_g_cm3=snow.density_g_cm3)
        mor_m = mor_from_extinction(extinction_per_m)
        yield next(name for below, name in SNOW_TERMS if mor_m < below)
    if weather.hail.rate_mm_h:
        yield f"hail of up to {weather.hail.largest_mm:g} mm"
    air = weather.air.mor_m
    if air is not None and air <= 5000:
        yield "haze"
