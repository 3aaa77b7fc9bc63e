"""Water at radio frequencies against published formulas and limits of Mie's series."""

import numpy as np
import pytest
from advercity_dsl.weather_components import Fog, Rain, Snow

from advercity.physics.microwaves import (
    Polarisation,
    PrecipitationEcho,
    compute_echo,
    fog_attenuation_db_km,
    mie_efficiencies,
    rain_attenuation_db_km,
    rain_coefficients,
    water_permittivity,
)
from advercity.physics.weather_parts.fog import find_droplets
from advercity.physics.weather_parts.part import Precipitation
from advercity.physics.weather_parts.rain import find_drops
from advercity.physics.weather_parts.snow import find_flakes


def echo_of(falling: Precipitation | None) -> PrecipitationEcho:
    assert falling is not None
    return compute_echo(falling.sizes, falling.permittivity)


@pytest.mark.parametrize(
    ("rate_mm_h", "attenuation_db_km", "backscatter_per_m"),
    [(4, 3.1, 3.4e-4), (8, 5.0, 5.6e-4), (40, 16.0, 1.6e-3), (50, 18.8, 1.8e-3)],
)
def test_rain_attenuates_and_scatters_as_tabulated(
    rate_mm_h: float, attenuation_db_km: float, backscatter_per_m: float
) -> None:
    rain = find_drops(Rain(rate_mm_h=rate_mm_h))
    assert rain is not None
    echo = echo_of(rain)
    assert rain.attenuation_db_km == pytest.approx(attenuation_db_km, abs=0.06)
    assert echo.backscatter_per_m == pytest.approx(backscatter_per_m, rel=0.05)


@pytest.mark.parametrize(
    ("frequency_ghz", "polarisation", "coefficient", "exponent"),
    [
        (5.0, "horizontal", 0.0002162, 1.6969),
        (5.0, "vertical", 0.0002428, 1.5317),
        (6.0, "vertical", 0.0004878, 1.5728),
        (10.0, "horizontal", 0.01217, 1.2571),
        (10.0, "vertical", 0.01129, 1.2156),
        (80.0, "horizontal", 1.1704, 0.7115),
    ],
)
def test_rain_has_the_coefficients_of_the_table_of_itu_r_p_838_3(
    frequency_ghz: float, polarisation: Polarisation, coefficient: float, exponent: float
) -> None:
    found = rain_coefficients(frequency_ghz, polarisation)
    assert found == pytest.approx((coefficient, exponent), rel=5e-4)


def test_rain_and_fog_cost_a_v2x_link_a_fraction_of_a_decibel_per_km() -> None:
    """0.000441 x 50 ** 1.580 is 0.213; water at 5.9 GHz has epsilon 78 - 26j or so at 10 deg C."""
    rain = rain_attenuation_db_km(50.0, 5.9, polarisation="vertical")
    assert rain == pytest.approx(0.213, abs=0.001)
    assert fog_attenuation_db_km(0.3, 5.9) < 0.01


def test_the_drops_of_mie_attenuate_within_a_third_of_what_itu_has() -> None:
    # Marshall and Palmer have more small drops than the rain that the recommendation was fitted to.
    for rate in (4, 50):
        by_drops = echo_of(find_drops(Rain(rate_mm_h=rate))).attenuation_db_km
        itu = rain_attenuation_db_km(rate, 77.0, polarisation="horizontal")
        assert by_drops == pytest.approx(itu, rel=0.35)


def test_a_fog_of_63_m_costs_a_tenth_of_a_decibel_per_100_m_both_ways() -> None:
    assert fog_attenuation_db_km(1.0) == pytest.approx(3.0, abs=0.2)
    fog = find_droplets(Fog(mor_m=63, droplet_um=12))
    assert fog is not None
    water = fog.water_g_m3
    assert water == pytest.approx(0.19, abs=0.01)
    assert 0.2 * fog_attenuation_db_km(water) == pytest.approx(0.1, abs=0.03)


def test_dry_snow_is_nearly_nothing_and_wet_snow_is_more() -> None:
    dry, wet = (
        echo_of(find_flakes(Snow(rate_mm_h=1.5, density_g_cm3=density))) for density in (0.1, 0.2)
    )
    assert dry.attenuation_db_km < 1.0 < wet.attenuation_db_km
    rain = echo_of(find_drops(Rain(rate_mm_h=1.5)))
    assert dry.backscatter_per_m < wet.backscatter_per_m < rain.backscatter_per_m


@pytest.mark.parametrize(("temperature_c", "high"), [(26.85, 3.52), (0.0, 2.7805), (40.0, 3.8358)])
def test_water_far_above_its_relaxations_has_the_permittivity_of_liebe(
    temperature_c: float, high: float
) -> None:
    """3.52 - 7.52 (300 K / T - 1): Liebe, Hufford and Manabe, Int. J. Infrared 12, 659, 1991."""
    assert water_permittivity(temperature_c, 1e8).real == pytest.approx(high, abs=2e-3)


def test_small_spheres_scatter_by_rayleigh_and_large_ones_shadow_twice_their_area() -> None:
    index = np.sqrt(water_permittivity())
    contrast = (index**2 - 1) / (index**2 + 2)
    size = np.array([0.02])
    extinction, back = mie_efficiencies(size, index)
    assert back[0] == pytest.approx(4 * size[0] ** 4 * abs(contrast) ** 2, rel=1e-2)
    assert extinction[0] == pytest.approx(4 * size[0] * contrast.imag, rel=1e-2)
    assert mie_efficiencies(np.array([300.0]), index)[0][0] == pytest.approx(2.0, abs=0.1)
