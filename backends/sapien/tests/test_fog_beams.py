"""The table of light that fog scatters out of beams."""

import math

import numpy as np
import pytest
from advercity_sapien.fog_beams import compute_fog_beam_rows
from advercity_sapien.shader_table import FOG_BEAM_RINGS, FOG_BEAM_SPOKES

from advercity.physics.lamp_beams import FRONT_FOG_BEAM, LOW_BEAM, LampBeam

FINE = 64
BEAMS = pytest.mark.parametrize(
    ("row", "lamp_beam"), [(0, LOW_BEAM), (1, FRONT_FOG_BEAM)], ids=["dipped", "fog"]
)


def flux_of(lamp_beam: LampBeam) -> float:
    """Lumens per candela of the peak."""
    step = math.radians(0.1)
    h, v = np.meshgrid(np.arange(-60.0, 60.0, 0.1), np.arange(-20.0, 20.0, 0.1))
    level, aside, above = np.cos(np.radians(v)), np.radians(h), np.radians(v)
    rays = np.stack([level * np.cos(aside), level * np.sin(aside), np.sin(above)], axis=-1)
    light = (
        lamp_beam.relative_intensity(np.array([[1.0, 0.0, 0.0]]), rays.reshape(1, -1, 3))[0]
        * level.ravel()
    )
    return float(light.sum()) * step**2


@BEAMS
def test_all_that_leaves_a_beam_goes_out_through_a_sphere_around_the_lamp(
    row: int, lamp_beam: LampBeam
) -> None:
    """The light scattered on the first metre is that of the beam times its optical depth."""
    table = compute_fog_beam_rows()[row].reshape(FOG_BEAM_RINGS, FOG_BEAM_SPOKES, 4)
    ring = (np.arange((FOG_BEAM_RINGS - 1) * FINE) + 0.5) / FINE
    inner, part = ring.astype(int), (ring % 1.0)[:, None, None]
    light = table[inner] * (1.0 - part) + table[inner + 1] * part
    off = math.pi * (ring / (FOG_BEAM_RINGS - 1)) ** 2
    wide = 2.0 * math.pi * ring / (FOG_BEAM_RINGS - 1) ** 2 / FINE
    turn = 2.0 * math.pi * np.arange(FOG_BEAM_SPOKES) / FOG_BEAM_SPOKES
    out = np.stack(
        np.broadcast_arrays(
            np.cos(off)[:, None],
            *(np.sin(off)[:, None] * along for along in (np.cos(turn), np.sin(turn))),
        ),
        axis=-1,
    )
    through = np.einsum("rsi,rsi->rs", light[..., :3], out)
    total = np.sum(through * (np.sin(off) * wide)[:, None]) * 2.0 * math.pi / FOG_BEAM_SPOKES
    assert total == pytest.approx(flux_of(lamp_beam), rel=0.05)


@BEAMS
def test_flow_does_not_exceed_fluence(row: int, lamp_beam: LampBeam) -> None:
    table = compute_fog_beam_rows()[row]
    assert (np.linalg.norm(table[:, :3], axis=1) <= table[:, 3] * 1.001).all()


def test_the_road_ahead_gets_what_a_beam_over_it_loses() -> None:
    """A dipped beam passes over the road 5 m ahead, which light from it falls on, not to it."""
    table = compute_fog_beam_rows()[0].reshape(FOG_BEAM_RINGS, FOG_BEAM_SPOKES, 4)
    below = table[3, 3 * FOG_BEAM_SPOKES // 4]
    assert below[2] < -0.2 * below[0] < 0.0
