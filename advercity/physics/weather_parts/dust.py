"""Airborne mineral dust."""

from collections.abc import Iterator

from advercity_dsl import Weather
from advercity_dsl.weather_components import Dust

from advercity.physics.extinction import extinction_from_mor
from advercity.physics.scattering import PhaseLobes
from advercity.physics.weather_parts.part import Extinction, PartPhysics, Suspension

TERMS = ((500, "severe dust storm"), (1000, "dust storm"))
"""Upper limit of visibility in metres for each term."""
FACTOR_905NM = 0.95
"""Extinction at 905 nm relative to 550 nm: coarse grains hardly discriminate."""
INFRARED_FACTOR = 0.4
"""Extinction in the infrared: between 0.3 and 0.6 for grains of 1 to 2 um."""
INFRARED_DEPTH_M = 2200.0
"""Height of dust in the infrared, as of water vapour."""
LIDAR_RATIO_SR = 50.0
LAYER_M = 300.0
"""Depth of even dust with the optical depth of a storm: 3 at a visibility of 300 m."""


def find_grains(dust: Dust) -> Suspension | None:
    """Find the grains of dust."""
    if dust.mor_m is None:
        return None
    visible = extinction_from_mor(dust.mor_m)
    extinction = Extinction(visible, visible * FACTOR_905NM)
    return Suspension(
        "dust",
        extinction,
        dust.mor_m,
        INFRARED_DEPTH_M,
        INFRARED_FACTOR,
        layer_m=LAYER_M,
        lobes=PhaseLobes.from_mean_cosine(dust.g),
        albedo=dust.ssa_rgb,
        lidar_ratio_sr=LIDAR_RATIO_SR,
    )


def _list_words(dust: Dust, weather: Weather) -> Iterator[str]:
    mor_m = dust.mor_m
    if mor_m is not None:
        yield next((name for below, name in TERMS if mor_m < below), "dust in the air")


PHYSICS = PartPhysics(find_grains, list_words=_list_words)
