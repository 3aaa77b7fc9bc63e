"""What surfaces send back at 905 nm: diffuse, glossy and retroreflecting, dry, wet or snowed on."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.casting import MATERIAL_NAMES, Hits
from advercity.semantics import Semantic
from advercity.weather.water import fresnel
from advercity.world.materials import MATERIALS

Floats = NDArray[np.floating[Any]]

WATER_INDEX = 1.328
"""Refractive index of water at 905 nm."""
PANE_TRANSMITTANCE = 0.85
"""Share of the light that gets through a window, one way."""
SNOW_REFLECTANCE = 0.8
GLOSS_RAD = 0.07
"""Width of the highlight of varnish: a beam that meets it within 4 degrees comes straight back."""
_INTERNAL_REFLECTANCE = 0.4702
_BEADS_FADE_BELOW = 0.05
"""Cosine of incidence below which glass beads in paint shade each other."""
_WET_BEADS = 0.2
"""What rain leaves of their echo."""


def _table(values: dict[str, float]) -> Floats:
    return np.array([values.get(name, 0.0) for name in MATERIAL_NAMES], np.float32)


_DIFFUSE = np.array([MATERIALS[name].reflectance_905nm for name in MATERIAL_NAMES], np.float32)
_VARNISHED = np.array(["car_paint" in name for name in MATERIAL_NAMES], np.float32)
_SHEETING = _table(
    {"sign_red": 300.0, "sign_yellow": 300.0, "licence_plate": 190.0, "lamp_red": 20.0}
)
"""Retroreflectors by their equivalent reflectance, pi times the coefficient R_A in cd/(lx m²)."""
_BEADS = _table({"paint_white": 0.5, "paint_yellow": 0.5})
"""Glass beads in lane paint: pi times R_L of EN 1436, at any angle."""
_IS_PLAIN = (_VARNISHED + _SHEETING + _BEADS) == 0.0
IS_GLASS = np.array([name == "glass" for name in MATERIAL_NAMES])


def reflected_share(
    hits: Hits, *, wetness: float = 0.0, snow: float = 0.0, snow_on_road: float = 0.0
) -> Floats:
    """Reflectance at 905 nm times cosine of incidence (n,); above 1 for retroreflectors.

    Rain leaves its film and snow its cover on what faces up; walls and windows stay as they are.

    Args:
        hits: What was met.
        wetness: 0 dry to 1 soaked.
        snow: Share of the ground under snow.
        snow_on_road: The same of carriageways.
    """
    reflectance = _DIFFUSE.take(hits.material)
    upward = np.clip(hits.normal[:, 2], 0.0, 1.0) if wetness or snow or snow_on_road else None
    if upward is not None and (snow or snow_on_road):
        on_road = (hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE)
        cover = np.array([snow, snow_on_road], np.float32).take(on_road)
        reflectance = reflectance + upward * cover * (np.float32(SNOW_REFLECTANCE) - reflectance)
    share = reflectance * hits.cosine
    if upward is not None and wetness:
        wet = wet_factor(reflectance, hits.cosine)
        share *= 1.0 + np.float32(wetness) * upward * (wet - 1.0)
    special = np.flatnonzero(~_IS_PLAIN.take(hits.material))
    share[special] += _special_share(
        hits.material.take(special), hits.cosine.take(special), wetness
    )
    return share


def _special_share(material: NDArray[np.int16], cosine: Floats, wetness: float) -> Floats:
    """What varnish, sheeting and beads add (k,)."""
    gloss = np.exp((cosine - 1.0) / GLOSS_RAD**2)
    beads = np.minimum(cosine / _BEADS_FADE_BELOW, 1.0) * (1.0 - (1.0 - _WET_BEADS) * wetness)
    return (
        _VARNISHED[material] * gloss
        + _SHEETING[material] * cosine**2
        + _BEADS[material] * beads.astype(np.float32)
    )


def wet_factor(reflectance: Floats, cosine: Floats) -> Floats:
    """Echo (n,) of a target under a film of water against the same target dry.

    Light crosses the surface twice and is partly held inside (Angstrom 1925; Lekner and Dorf
    1988); at grazing incidence most of it glances off.
    """
    passed = 1.0 - fresnel(cosine, WATER_INDEX)
    return passed**2 / (WATER_INDEX**2 * (1.0 - reflectance * _INTERNAL_REFLECTANCE))
