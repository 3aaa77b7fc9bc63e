import numpy as np
import pytest

from advercity.weather import puddles

PLACES = np.random.default_rng(3).uniform(-400.0, 400.0, (200_000, 2))


@pytest.mark.parametrize("coverage", [0.05, 0.35, 0.9])
def test_water_covers_the_share_that_is_asked_for(coverage: float) -> None:
    assert puddles.covered(PLACES, coverage).mean() == pytest.approx(coverage, abs=0.01)


def test_dry_ground_has_no_puddles() -> None:
    assert not puddles.covered(PLACES, 0.0).any()


def test_more_water_covers_whatever_less_covers() -> None:
    little, much = (puddles.covered(PLACES, coverage) for coverage in (0.1, 0.4))
    assert np.all(much[little])


def test_the_ground_between_texels_is_linear() -> None:
    heights = puddles.field()
    at = np.array([[0.0, 0.0], [0.0, puddles.TEXEL_M], [puddles.TEXEL_M / 2, 0.0]])
    expected = [heights[0, 0], heights[1, 0], (heights[0, 0] + heights[0, 1]) / 2]
    assert puddles.height(at) == pytest.approx(expected)
