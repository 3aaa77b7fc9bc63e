"""Weathers are called what meteorologists call them."""

from typing import Any

import pytest
from advercity_dsl import Weather

from advercity.physics.weather_text import format_weather


def text(**parts: Any) -> str:
    said = {"id": "tried", "time": "day", "sun": {"elevation_deg": 60}} | parts
    return format_weather(Weather.model_validate(said))


@pytest.mark.parametrize(
    ("oktas", "term"),
    [
        *((0, "clear"), (1, "few clouds"), (2, "few clouds")),
        *((3, "scattered clouds"), (4, "scattered clouds")),
        *((5, "broken clouds"), (7, "broken clouds"), (8, "overcast")),
    ],
)
def test_eighths_of_cloud_are_named_as_by_observers(oktas: int, term: str) -> None:
    assert f": {term}, " in text(sky={"oktas": oktas})


@pytest.mark.parametrize(
    ("rate_mm_h", "term"),
    [
        *((0.5, "light rain"), (2.5, "light rain"), (2.6, "moderate rain")),
        *((7.6, "moderate rain"), (7.7, "heavy rain"), (50, "heavy rain"), (51, "violent rain")),
    ],
)
def test_rain_is_named_by_the_limits_of_the_glossary_of_meteorology(
    rate_mm_h: float, term: str
) -> None:
    assert term in text(rain={"rate_mm_h": rate_mm_h})
