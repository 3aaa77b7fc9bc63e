import numpy as np
import pytest

from advercity.physics import water

PLACES = np.random.default_rng(3).uniform(-400.0, 400.0, (200_000, 2))


@pytest.mark.parametrize("coverage", [0.05, 0.35, 0.9])
def test_water_covers_the_share_that_is_asked_for(coverage: float) -> None:
    assert water.is_in_puddle(PLACES, coverage).mean() == pytest.approx(coverage, abs=0.01)


def test_dry_ground_has_no_puddles() -> None:
    assert not water.is_in_puddle(PLACES, 0.0).any()


def test_more_water_covers_whatever_less_covers() -> None:
    little, much = (water.is_in_puddle(PLACES, coverage) for coverage in (0.1, 0.4))
    assert np.all(much[little])


def test_the_ground_between_texels_is_linear() -> None:
    heights = water.build_puddle_height_field()
    at = np.array([[0.0, 0.0], [0.0, water.PUDDLE_TEXEL_M], [water.PUDDLE_TEXEL_M / 2, 0.0]])
    expected = [heights[0, 0], heights[1, 0], (heights[0, 0] + heights[0, 1]) / 2]
    assert water.puddle_field_height(at) == pytest.approx(expected)
