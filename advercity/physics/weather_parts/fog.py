"""Fog: droplets scatter all light, and their water attenuates microwaves."""

from collections.abc import Iterator

from advercity_dsl import Weather
from advercity_dsl.weather_components import Fog

from advercity.physics.extinction import extinction_from_mor
from advercity.physics.scattering import PhaseLobes
from advercity.physics.weather_parts.part import Extinction, PartPhysics, Suspension

TERMS = ((50, "dense fog"), (200, "thick fog"), (1000, "fog"))
"""Upper limit of visibility in metres for each term (WMO, UK roads)."""
LIDAR_RATIO_SR = 18.8
"""Extinction over backscatter: O'Connor et al., JTECH 21, 777 (2004)."""


def find_droplets(fog: Fog) -> Suspension | None:
    """Find the droplets of fog, much larger than the wavelengths of light."""
    if fog.mor_m is None:
        return None
    visible = extinction_from_mor(fog.mor_m)
    return Suspension(
        "fog",
        Extinction(visible, visible),
        fog.mor_m,
        infrared_depth_m=fog.depth_m,
        layer_m=fog.depth_m,
        lobes=PhaseLobes.from_diameter_um(fog.droplet_um),
        lidar_ratio_sr=LIDAR_RATIO_SR,
        droplet_um=fog.droplet_um,
    )


def _list_words(fog: Fog, weather: Weather) -> Iterator[str]:
    mor_m = fog.mor_m
    if mor_m is not None:
        yield next((name for below, name in TERMS if mor_m < below), "mist")


PHYSICS = PartPhysics(find_droplets, list_words=_list_words)
