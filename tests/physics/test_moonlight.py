"""Moonlight by phase, height, clouds and fog."""

from typing import Any

import pytest
from advercity_dsl import Weather

from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.moonlight import compute_moon_lx, compute_moonlight
from advercity.physics.sky import direction_from_elevation_azimuth


def night(**parts: Any) -> Weather:
    return Weather.model_validate(
        {"id": "tried", "time": "night", "sun": {"elevation_deg": -30}} | parts
    )


@pytest.mark.parametrize(
    ("phase", "lux"),
    # By hand: magnitudes -12.73, -12.73 + 1.56 + 0.05, -12.73 + 2.34 + 0.26, -12.73 + 3.12 + 0.83.
    [(1.0, 0.313), (0.75, 0.0711), (0.5, 0.0285), (0.25, 0.0082)],
)
def test_the_phase_sets_the_light_above_the_air(phase: float, lux: float) -> None:
    assert compute_moon_lx(phase) == pytest.approx(lux, rel=0.02)


def test_a_high_full_moon_gives_level_ground_a_quarter_of_a_lux() -> None:
    """The air takes of it what it takes of the sun: exp(-0.21) straight down."""
    found = compute_atmosphere(night(moon={"phase": 1, "elevation_deg": 90}), "rural")
    assert found.sun_lx == pytest.approx(0.313 * 0.811, rel=0.01)
    assert 0.25 < found.ground_lx < 0.32
    assert found.night
    assert found.is_dark


def test_the_light_comes_from_the_moon() -> None:
    found = compute_atmosphere(
        night(moon={"phase": 1, "elevation_deg": 30, "azimuth_deg": 90}), "rural"
    )
    assert found.sun_direction == pytest.approx(direction_from_elevation_azimuth(30, 90))


@pytest.mark.parametrize("moon", [{"phase": 0}, {"phase": 1, "elevation_deg": -5}])
def test_a_new_moon_and_one_that_has_set_change_nothing(moon: dict[str, float]) -> None:
    with_moon, without = (
        compute_atmosphere(night(**part), "rural") for part in ({"moon": moon}, {})
    )
    assert (with_moon.sky == without.sky).all()
    assert with_moon.sun_lx == without.sun_lx == 0.0
    assert (with_moon.sun_direction == without.sun_direction).all()


def test_clouds_and_fog_dim_the_moon() -> None:
    moon = {"phase": 1, "elevation_deg": 60}
    clear, cloudy, foggy = (
        compute_atmosphere(night(moon=moon, **part), "rural")
        for part in ({}, {"sky": {"oktas": 8}}, {"fog": {"mor_m": 75}})
    )
    assert cloudy.sun_lx == 0.0
    assert cloudy.ground_lx < 0.4 * clear.ground_lx
    assert foggy.sun_lx < 0.02 * clear.sun_lx
    assert foggy.ground_lx > 0.4 * clear.ground_lx


def test_the_moon_does_not_matter_by_day() -> None:
    moonlit = Weather.model_validate({"id": "tried", "time": "day", "moon": {"phase": 1}})
    day = Weather.model_validate({"id": "tried", "time": "day"})
    assert compute_moonlight(moonlit).direct_lx > 0.0
    assert (compute_atmosphere(moonlit, "rural").sky == compute_atmosphere(day, "rural").sky).all()


def test_specs_without_a_moon_do_not_mention_it() -> None:
    assert "moon" not in night().model_dump(mode="json")
    assert night(moon={"phase": 0.5}).model_dump(mode="json")["moon"]["phase"] == 0.5
