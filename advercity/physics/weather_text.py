"""A weather in words, by the terms of weather services."""

from collections.abc import Iterator

from advercity_dsl import Weather

from advercity.physics.weather_parts.part import iterate_parts, list_deposits

CLOUD_TERMS = ((0, "clear"), (2, "few clouds"), (4, "scattered clouds"), (7, "broken clouds"))
"""Highest cover in eighths for each term; 8 is overcast."""


def format_weather(weather: Weather) -> str:
    """Format a weather as `day: thick fog, overcast, wet road, -3 degC`.

    A changing weather ends with its last state.
    """
    text = f"{weather.time}: {', '.join(_describe_parts(weather))}"
    if not weather.keyframes:
        return text
    last_s = weather.keyframes[-1].at_s
    return f"{text}; by {last_s:g} s {format_weather(weather.at(last_s))}"


def _describe_parts(weather: Weather) -> Iterator[str]:
    for physics, part in iterate_parts(weather):
        yield from physics.list_words(part, weather)
    oktas = weather.sky.oktas
    yield next((name for highest, name in CLOUD_TERMS if oktas <= highest), "overcast")
    for deposit in list_deposits(weather):
        if deposit.road_coverage:
            yield f"{deposit.road_coverage:.0%} of the road under {deposit.name}"
    surface = weather.surface
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
