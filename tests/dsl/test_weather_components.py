"""Defaults of the weather's components, against their sources."""

import math

import pytest
from advercity_dsl.weather_components import Lamps, Night


def test_as_many_drivers_use_high_beams_as_were_counted() -> None:
    # Borzendowski, Stafford Sewall and Tyrrell (2015): 48 % of the time when they could.
    assert Lamps().high_beam == 0.48
    assert Lamps.model_validate({"high_beam": 1}).high_beam == 1.0


@pytest.mark.parametrize(
    ("land_use", "darkest", "brightest"), [("urban", 18.4, 17.5), ("rural", 21.3, 20.5)]
)
def test_the_night_sky_is_as_bright_as_bortles_classes(
    land_use: str, darkest: float, brightest: float
) -> None:
    """Class 4 for the country, 8 or 9 for towns, in magnitudes per square arcsecond."""
    luminance_cd_m2 = getattr(Night().glow_cd_m2, land_use)
    magnitude = -2.5 * math.log10(luminance_cd_m2 / 108_000)
    assert brightest < magnitude < darkest
