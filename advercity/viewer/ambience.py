"""The weather in figures, as it is plotted."""

import math

from advercity_dsl import Spec

from advercity.weather.derivation import atmosphere_of


def ambience(spec: Spec) -> dict[str, float]:
    """What the weather of a spec comes to, by quantity with its unit.

    The visibility (meteorological optical range) is left out where nothing limits it. The
    illuminance is that of level ground in the open: sun, sky and street lamps.
    """
    weather = spec.weather
    atmosphere = atmosphere_of(weather, spec.road.land_use)
    sun_lx = atmosphere.sun_lx * max(0.0, float(atmosphere.sun_direction[2]))
    found = {
        "visibility_m": atmosphere.mor_m,
        "rain_mm_h": weather.rain.rate_mm_h,
        "snow_mm_h": weather.snow.rate_mm_h,
        "illuminance_lx": sun_lx + atmosphere.sky_lx + atmosphere.street_lx,
        "wetness": atmosphere.wetness,
    }
    return {name: value for name, value in found.items() if math.isfinite(value)}
