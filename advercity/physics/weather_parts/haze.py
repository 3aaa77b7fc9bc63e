"""Clear air and haze."""

from collections.abc import Iterator

from advercity_dsl import Weather
from advercity_dsl.weather_components import Air

from advercity.physics.extinction import extinction_from_mor, kim_wavelength_factor
from advercity.physics.weather_parts.part import Extinction, PartPhysics, Suspension

HAZE_BELOW_M = 5000.0
"""Maximum visibility at which texts mention haze."""
INFRARED_NM = 10_000.0
INFRARED_DEPTH_M = 2200.0
"""Height of haze in the infrared, as of water vapour."""


def find_haze(air: Air) -> Suspension | None:
    """Find the particles of haze, nearly transparent to thermal cameras and no target of LiDARs."""
    if air.mor_m is None:
        return None
    visible = extinction_from_mor(air.mor_m)
    extinction = Extinction(visible, visible * kim_wavelength_factor(air.mor_m))
    infrared = kim_wavelength_factor(air.mor_m, wavelength_nm=INFRARED_NM)
    return Suspension("air", extinction, air.mor_m, INFRARED_DEPTH_M, infrared)


def _list_words(air: Air, weather: Weather) -> Iterator[str]:
    if air.mor_m is not None and air.mor_m <= HAZE_BELOW_M:
        yield "haze"


PHYSICS = PartPhysics(find_haze, list_words=_list_words)
