"""The table of light that fog scatters out of beams."""

import math

import numpy as np
import pytest

from advercity.geometry.arrays import Float32Array
from advercity.physics.lamp_beams import LOW_BEAM
from advercity.rendering.fog_beams import (
    FOG_BEAM_NODES,
    HIGH_CORNER_M,
    compute_fog_beams,
    grid_corners,
    trace_beam,
)

THIN = 1e-4


@pytest.fixture(scope="module")
def thin() -> Float32Array:
    """Light scattered out of a low beam by the thinnest fog (nodes ahead, right, up, 4)."""
    return trace_beam(LOW_BEAM, 0.65, 0.0, THIN)[0]


def node_at(ahead_m: float, right_m: float, up_m: float) -> tuple[int, ...]:
    """The node next to a place."""
    low, high = grid_corners()
    root = np.sign(ahead_m) * math.sqrt(abs(ahead_m)), math.sqrt(right_m), math.sqrt(up_m)
    place = (np.array(root) - low) / (high - low) * (np.array(FOG_BEAM_NODES) - 1)
    return tuple(np.round(place).astype(int).tolist())


def test_scattered_light_leaves_upwards_above_a_beam_and_downwards_below_it(
    thin: Float32Array,
) -> None:
    assert thin[node_at(12.0, 0.0, 8.0)][2] > 0.0 > thin[node_at(5.0, 0.0, 0.0)][2]


def test_scattered_light_goes_mostly_on_ahead(thin: Float32Array) -> None:
    """The wide lobe's mean cosine is 0.74."""
    ahead, _, _, fluence = thin[node_at(40.0, 3.0, 2.0)]
    assert 0.5 * fluence < ahead < fluence


def test_flow_does_not_exceed_fluence(thin: Float32Array) -> None:
    assert (np.linalg.norm(thin[..., :3], axis=-1) <= thin[..., 3] * 1.001).all()


def test_twice_as_much_thin_fog_scatters_twice_as_much(thin: Float32Array) -> None:
    twice = trace_beam(LOW_BEAM, 0.65, 0.0, 2.0 * THIN)[0]
    lit = thin[..., 3] > 0.0
    ratio = np.median(twice[..., 3][lit] / thin[..., 3][lit])
    assert ratio == pytest.approx(2.0, rel=0.05)


def test_the_road_reflects_upwards_what_no_fog_has_scattered_before() -> None:
    """A beam of 1 cd at the peak gives the road 10 m ahead about 1 / 10² * 0.65 / 10 lx."""
    by_fog, with_road = trace_beam(LOW_BEAM, 0.65, 0.0, THIN)
    by_road = (with_road - by_fog)[node_at(10.0, 0.0, 1.0)]
    assert by_road[2] > 0.5 * by_road[3] > 0.0
    reflected_lx = 0.1 * 0.65 / 10.0**3
    assert 0.2 * reflected_lx < by_road[2] < reflected_lx


def test_nothing_is_left_where_the_table_ends() -> None:
    tables = compute_fog_beams(0.05)
    assert tables.shape == (2, 2, *FOG_BEAM_NODES, 4)
    low_beam = tables[0, 0]
    assert low_beam[-1].max() == low_beam[:, -1].max() == low_beam[:, :, -1].max() == 0.0
    assert HIGH_CORNER_M[0] > 100.0


def test_nearly_equal_fogs_have_the_same_table() -> None:
    assert compute_fog_beams(0.0500) is compute_fog_beams(0.0501)
