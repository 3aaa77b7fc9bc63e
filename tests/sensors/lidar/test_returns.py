"""Merging and selection of returns."""

import numpy as np
import pytest

from advercity.randomness import create_generator
from advercity.sensors.lidar import (
    cast_scan,
)
from advercity.sensors.lidar.returns import ReturnMode, Returns, select_reported
from tests.sensors.lidar.builders import (
    EXACT,
    STAND,
    VACUUM,
    measure,
    panel,
    raycaster_of,
    upright,
    vary,
)


def returns_of_every_beam(kind: int, beams: int = 4000) -> Returns:
    """One echo a beam at most, some of which overlap others; the kind tells them apart."""
    rng = create_generator("echoes", kind)
    power = rng.uniform(0.3, 3.0, beams) * (rng.random(beams) < 0.8)
    return Returns(
        beam=np.arange(beams, dtype=np.int32),
        range_m=rng.uniform(5.0, 9.0, beams).astype(np.float32),
        power=power.astype(np.float32),
        noise=rng.standard_normal(beams, np.float32),
        kind=np.full(beams, kind, np.uint8),
        semantic=np.zeros(beams, np.uint8),
        instance=np.zeros(beams, np.int32),
    )


@pytest.mark.parametrize("report", ["strongest", "last", "dual"])
def test_the_comparison_of_two_sources_selects_what_sorting_selects(report: ReturnMode) -> None:
    one, other = returns_of_every_beam(1), returns_of_every_beam(2)
    third = returns_of_every_beam(3).select(np.arange(len(one)) % 5 == 0)
    quick = select_reported([one, other], [third], len(one), report, 0.749)
    slow = select_reported([], [one, other, third], len(one), report, 0.749)
    assert len(slow) > 1000
    for column in ("beam", "range_m", "power", "kind"):
        np.testing.assert_array_equal(getattr(quick, column), getattr(slow, column))


def test_a_beam_across_an_edge_returns_twice() -> None:
    caster = raycaster_of(upright(10, 2, 6), upright(14, 50, 20))
    twice: list[int] = []
    for sub_rays in (1, 7):
        lidar = vary(EXACT, sub_rays=sub_rays, echoes="dual", upper_deg=5, lower_deg=1)
        found = measure(lidar, cast_scan(lidar, STAND, caster))
        twice.append(int((np.diff(found.ring.astype(int)) == 0).sum()))
    assert twice[0] == 0
    assert twice[1] >= 32


def test_the_power_of_sub_rays_adds_up() -> None:
    fine = vary(EXACT, sub_rays=7)
    found = measure(fine, panel(20.0, fine, "plaster"), **VACUUM)
    assert len(found.points) == 120_000
    np.testing.assert_allclose(found.intensity, 0.6, rtol=1e-4)
    np.testing.assert_allclose(found.range_m, 20.0, atol=1e-4)
