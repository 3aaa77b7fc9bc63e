"""Cubemaps."""

import math

import numpy as np
import pytest

from advercity.physics import photometry


def test_cubemap_faces_have_the_documented_axes() -> None:
    upper_left = photometry.cubemap_directions(2)[:, 0, 0] * math.sqrt(1.5)
    expected = [
        (1, 0.5, 0.5),
        (-1, -0.5, 0.5),
        (-0.5, 1, 0.5),
        (0.5, -1, 0.5),
        (-0.5, 0.5, 1),
        (0.5, 0.5, -1),
    ]
    np.testing.assert_allclose(upper_left, expected, atol=1e-12)
    assert 6 * photometry.cubemap_solid_angles(64).sum() == pytest.approx(12.5671, abs=1e-4)
