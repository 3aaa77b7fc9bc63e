"""Light of sky and sun, and its changes by the air, on the device.

Radiance is in kcd/m², irradiance in klx: no value is far from 1.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from advercity.physics.atmosphere import Atmosphere
from advercity.physics.photometry import stack_cubemap
from advercity.rendering.fog_beams import FOG_BEAM_NODES, compute_fog_beams, grid_corners
from advercity.rendering.visible_sky import draw_visible_sky
from advercity_mitsuba.variant import dr, mi

KILO = 1e-3
"""Factor from cd/m² and lx to kcd/m² and klx."""

LEAST_DEFLECTING = 6e-3
"""Extinction, 1/m, above which fog deflects light visibly."""


@dataclass(frozen=True, eq=False)
class Light:
    """Light of an atmosphere, fields as there.

    Attributes:
        sky: Texture of the cubemap with its clouds, the faces below each other.
        airlight: Texture of the airlight's cubemap.
        fog_beams: By night, the texture of the light scattered by fog out of low beams, then out of
            front fog lamps, with the road's reflection.
        extinction: 1/m.
        sun_direction: Unit vector.
        sun_irradiance: On a surface facing the sun.
        has_air: Whether air attenuates anything.
        has_sun: Whether there is direct sunlight.
        night: Whether lamps light the scene.
        deflects: Whether small deflections by fog are visible.
    """

    sky: Any
    airlight: Any
    fog_beams: Any
    extinction: Any
    sun_direction: Any
    sun_irradiance: Any
    has_air: bool
    has_sun: bool
    night: bool
    deflects: bool


def upload_light(atmosphere: Atmosphere) -> Light:
    """Copy the light of an atmosphere to the device."""
    air = atmosphere.airlight * np.array([KILO, KILO, KILO, 1.0], np.float32)
    light = Light(
        sky=_stack_faces(draw_visible_sky(atmosphere) * np.float32(KILO)),
        airlight=_stack_faces(air),
        fog_beams=_upload_fog_beams(atmosphere) if atmosphere.night else None,
        extinction=mi.Float(atmosphere.extinction.at_550nm),
        sun_direction=mi.Vector3f(*map(float, atmosphere.sun_direction)),
        sun_irradiance=mi.Color3f(
            *(part * atmosphere.sun_lx * KILO for part in atmosphere.sun_colour)
        ),
        has_air=atmosphere.extinction.at_550nm > 0.0,
        has_sun=atmosphere.sun_lx > 0.0,
        night=atmosphere.night,
        deflects=atmosphere.extinction.at_550nm > LEAST_DEFLECTING,
    )
    dr.make_opaque(light.extinction, light.sun_direction, light.sun_irradiance)
    return light


def _stack_faces(faces: Any) -> Any:
    stacked = stack_cubemap(faces.astype(np.float32))
    return mi.Texture2f(mi.TensorXf(stacked), wrap_mode=dr.WrapMode.Clamp, use_accel=False)


def _upload_fog_beams(atmosphere: Atmosphere) -> Any:
    # The second table of each beam includes the road's reflection, as glow does.
    tables = compute_fog_beams(atmosphere.extinction.at_550nm)[:, 1]
    values = mi.TensorXf(tables.reshape(-1, *tables.shape[2:]))
    return mi.Texture3f(values, wrap_mode=dr.WrapMode.Clamp, use_accel=False)


def look_up_fog_beam(light: Light, is_fog_beam: Any, root: tuple[Any, Any, Any]) -> list[Any]:
    """Look up flow ahead, to the right and up, and fluence, of light scattered out of beams.

    By roots of the metres ahead of the lamp, to either side, and above the ground; 0 far away.
    """
    inside, place = mi.Bool(True), list[Any]()
    for at, low, high, nodes in zip(root, *grid_corners(), FOG_BEAM_NODES, strict=True):
        node = (at - float(low)) * ((nodes - 1) / float(high - low))
        inside &= (node >= 0.0) & (node < nodes - 1)
        place.append((node + 0.5) / nodes)
    ahead, right, up = place
    # One beam's table is below the other's, and both end in zeros.
    row = dr.select(is_fog_beam, 0.5 * ahead + 0.5, 0.5 * ahead)
    found = light.fog_beams.eval(mi.Point3f(up, right, row), active=inside)
    return [dr.select(inside, each, 0.0) for each in found]


def look_up_sky(light: Light, ray: Any) -> Any:
    """Look up the radiance of the sky along rays."""
    return mi.Color3f(*_look_up(light.sky, ray)[:3])


def _look_up(cubemap: Any, ray: Any) -> Any:
    texels = cubemap.shape[1]
    x, y, z = ray
    size = dr.abs(ray)
    on_x, on_y = (size.x >= size.y) & (size.x >= size.z), size.y >= size.z
    face = dr.select(
        on_x,
        dr.select(x > 0.0, mi.Float(0.0), 1.0),
        dr.select(
            on_y, dr.select(y > 0.0, mi.Float(2.0), 3.0), dr.select(z > 0.0, mi.Float(4.0), 5.0)
        ),
    )
    right = dr.select(
        on_x, dr.select(x > 0.0, -y, y), dr.select(on_y, dr.select(y > 0.0, x, -x), -y)
    )
    down = dr.select(on_x | on_y, -z, dr.select(z > 0.0, x, -x))
    longest = dr.select(on_x, size.x, dr.select(on_y, size.y, size.z))
    # The outermost texels of a face belong to its neighbours, for the filter.
    inside = 0.5 - 1.0 / texels
    u, v = right / longest * inside + 0.5, down / longest * inside + 0.5
    return cubemap.eval(mi.Point2f(u, (v + face) / 6.0))


def compute_transmittance(light: Light, distance: Any) -> Any:
    """Compute the transmittance of the air over a distance."""
    return dr.exp(-light.extinction * distance)


def compute_airlight(light: Light, ray: Any, distance: Any) -> Any:
    """Compute the light added by the air over a distance along rays."""
    depth = light.extinction * distance
    left = dr.exp(-depth)
    red, green, blue, growth = _look_up(light.airlight, ray)
    opacity = 1.0 - left + growth * (1.0 - left * (1.0 + depth))
    return mi.Color3f(red, green, blue) * opacity
