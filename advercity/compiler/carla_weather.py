"""Fields here for the fields of CARLA's weather, whose percentages and angles have no others."""

from advercity_dsl.base import ValuePath

_FROM_ATMOSPHERE = "leave it out: it follows from air, fog and dust"
FIELDS = {
    "cloudiness": "of CARLA's percentage, write sky: {oktas: 8} for 100, 4 for 50",
    "precipitation": "CARLA's percentage is no rate; write rain: {rate_mm_h: 2.5} for light rain, "
    "8 for moderate, 50 for violent",
    "precipitation_deposits": "of CARLA's percentage, write surface: {wetness: 1, "
    "puddle_coverage: 0.5} for 50",
    "wetness": "of CARLA's percentage, write surface: {wetness: 0.5} for 50",
    "wind_intensity": "CARLA's percentage is no speed; write wind: {speed_m_s: 3} for a light "
    "breeze, 15 for a near gale",
    "fog_density": "CARLA's percentage is no visibility; write fog: {mor_m: 500} for the range at "
    "which contrast is 5 %",
    "fog_distance": "leave it out: fog is everywhere, and fog.mor_m says how dense",
    "fog_falloff": "write fog: {depth_m: 100} for how high the fog is",
    "dust_storm": "CARLA's percentage is no visibility; write dust: {mor_m: 300}",
    "sun_altitude_angle": "write sun: {elevation_deg: ...}",
    "sun_azimuth_angle": "write sun: {azimuth_deg: ...}",
    "sun.altitude_deg": "write elevation_deg",
    "scattering_intensity": _FROM_ATMOSPHERE,
    "mie_scattering_scale": _FROM_ATMOSPHERE,
    "rayleigh_scattering_scale": _FROM_ATMOSPHERE,
}
"""Replacement for each field of `carla.WeatherParameters`."""


def suggest_for_carla_field(value_path: ValuePath) -> str:
    """Return the replacement for a field of CARLA's weather; empty for other fields."""
    return FIELDS.get(".".join(map(str, value_path)), "")
