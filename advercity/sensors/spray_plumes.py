"""Water that wheels throw up from a wet road: a plume behind each fast vehicle."""

from advercity_dsl.units import KM_H_PER_M_S

MIN_SPRAY_FILM_MM = 0.3
MIN_SPRAY_SPEED_M_S = 30.0 / KM_H_PER_M_S
SPRAY_REFERENCE_SPEED_M_S = 60.0 / KM_H_PER_M_S
SPRAY_WATER_G_M3 = 0.5
"""Liquid water right behind a vehicle at that speed; it grows with the square of the speed."""
SPRAY_EXTINCTION_PER_G_M3 = 0.03
"""Extinction in 1/m of 1 g/m³ of drops with a Sauter diameter of 0.1 mm."""
PLUME_LENGTH_M, PLUME_HEIGHT_M = 12.0, 1.3
PLUME_DECAY_M = 6.5
MAX_PLUME_DISTANCE_M = 60.0
"""Plumes farther away are left out: they send back too little and dim too little."""
SPRAYING_CLASSES = ("car", "van", "truck", "motorcycle")


def has_spray(water_film_mm: float) -> bool:
    """Whether enough water lies on the road."""
    return water_film_mm > MIN_SPRAY_FILM_MM
