"""Lamps by hand: where their light is strongest, where it ends, and how much strays."""

import math

import numpy as np
import pytest

from advercity.geometry.arrays import Float64Array
from advercity.physics.lamp_beams import (
    BEAMS,
    FRONT_FOG_BEAM,
    HIGH_BEAM,
    LED_LOW_BEAM,
    LEFT_HAND_PATTERNS,
    LENS,
    LOW_BEAM,
    LampBeam,
    LampPattern,
    LightSource,
    intensity_towards,
)

AHEAD = np.array([1.0, 0.0, 0.0])


def ray(right_deg: float, up_deg: float) -> Float64Array:
    right, up = math.radians(right_deg), math.radians(up_deg)
    level = math.cos(up)
    return np.array([[level * math.cos(right), -level * math.sin(right), math.sin(up)]])


LOW = [
    # At the peak, 1.8 degrees below a cut-off at 0.27 - 0.57.
    (1.0, -2.1, 1.0),
    # On the level part of the cut-off half of what does not stray, at half a deviation aside.
    (-5.0, -0.57, (0.018 + 0.982 / 2) * math.exp(-0.125)),
    # Above it what strays, falling to 1/e at 15 degrees.
    (-5.0, 5.0, 0.018 * math.exp(-1 / 9) * math.exp(-0.125)),
    (1.0, 15.0, 0.018 * math.exp(-1)),
    # The cut-off is 2.07 degrees higher from 7.67 degrees on to the right.
    (13.0, 1.5, (0.018 + 0.982 / 2) * math.exp(-0.01) * math.exp(-0.5)),
    (5.0, 1.35 - 0.57, (0.018 + 0.982 / 2) * math.exp(-((0.78 / 15) ** 2)) * math.exp(-1 / 18)),
    # 2.8 degrees below the peak.
    (1.0, -4.9, math.exp(-1)),
    (91.0, -2.0, 0.0),
]
FOG = [
    (0.0, -1.0, 1.0),
    (0.0, 0.0, 0.018 + 0.982 / 2),
    (20.0, -1.0, math.exp(-0.5)),
    (0.0, -4.5, math.exp(-1)),
    (0.0, 15.0, 0.018 * math.exp(-1)),
    (-91.0, -1.0, 0.0),
]


@pytest.mark.parametrize(
    ("beam", "right_deg", "up_deg", "expected"),
    [*((LOW_BEAM, *row) for row in LOW), *((FRONT_FOG_BEAM, *row) for row in FOG)],
)
def test_a_headlamp_shines_below_its_cutoff(
    beam: LampBeam, right_deg: float, up_deg: float, expected: float
) -> None:
    found = beam.relative_intensity(AHEAD, ray(right_deg, up_deg))
    assert found == pytest.approx(np.array([expected]), rel=7e-3, abs=1e-9)


@pytest.mark.parametrize(
    ("beam", "above_deg", "expected"),
    # Over 0.12 degrees of softness from light to dark, 1 / (1 + e); over 0.2 for fog lamps.
    [(LOW_BEAM, 0.12, 0.2689), (LOW_BEAM, -0.12, 0.7311), (FRONT_FOG_BEAM, 0.2, 0.2689)],
)
def test_the_cutoff_is_as_soft_as_the_lamp_is_sharp(
    beam: LampBeam, above_deg: float, expected: float
) -> None:
    found = beam.relative_intensity(AHEAD, ray(-3.0, above_deg - beam.cutoff_drop_deg))
    sideways = math.exp(-(((-3.0 - beam.peak_right_deg) / beam.horizontal_sigma_deg) ** 2) / 2)
    below = (min(above_deg, 0.0) + beam.peak_below_cutoff_deg) / beam.below_width_deg
    dimmed = math.exp(-(below**2)) if above_deg < 0.0 else 1.0
    assert found == pytest.approx(
        np.array([(0.018 + 0.982 * expected) * sideways * dimmed]), rel=2e-3
    )


def test_an_even_beam_has_the_light_of_the_peaked_one() -> None:
    """The integral of exp(-((x + 1.8) / 2.8)²) from the cut-off downwards, by a sum."""
    below_deg = (np.arange(300_000) + 0.5) * 1e-4
    for beam in (LOW_BEAM, LED_LOW_BEAM, FRONT_FOG_BEAM, HIGH_BEAM):
        off = (beam.peak_below_cutoff_deg - below_deg) / beam.below_width_deg
        assert beam.equivalent_height_deg == pytest.approx(1e-4 * np.exp(-(off**2)).sum(), rel=1e-4)


def test_droplets_dissolve_a_cutoff_and_keep_the_light() -> None:
    """Half of the light at the edge of an even beam that is much higher than the spread."""
    spread = np.array([0.01])
    edge = LOW_BEAM.scattered_intensity(AHEAD, ray(1.0, 0.27 - 0.57), spread)
    middle = LOW_BEAM.scattered_intensity(AHEAD, ray(1.0, 0.27 - 0.57 - 2.0), spread)
    beyond = LOW_BEAM.scattered_intensity(AHEAD, ray(1.0, 5.0), spread)
    assert edge == pytest.approx(np.array([0.5 + 0.018 / 2]), rel=0.01)
    assert middle == pytest.approx(np.array([1.0]), rel=0.01)
    assert beyond == pytest.approx(np.array([0.018 * math.exp(-1 / 9)]), rel=0.1)
    # The light of all heights stays, however wide it is spread.
    heights = np.arange(-90.0, 90.0, 0.02)
    rays = np.concatenate([ray(1.0, height) for height in heights])
    for spread_deg in (0.2, 2.0):
        light = LOW_BEAM.scattered_intensity(AHEAD, rays, np.full(len(rays), spread_deg))
        assert 0.02 * light.sum() == pytest.approx(LOW_BEAM.equivalent_height_deg, rel=0.12)


def test_droplets_spread_a_high_beam_about_its_axis() -> None:
    spread = np.array([1.0])
    found = [HIGH_BEAM.scattered_intensity(AHEAD, ray(0.0, up), spread)[0] for up in (-4, 0, 4)]
    assert found[1] > 0.7
    assert found[0] == pytest.approx(found[2], rel=0.01)


def test_a_lens_is_half_as_bright_at_10_degrees_and_dark_at_90() -> None:
    angles = np.radians([0, 10, 12, 20, 45, 90, 120])
    found = LENS.relative_intensity(np.cos(angles))
    # At 12 degrees the unshifted light is 2^-1.25, of which 0.00818 is at a right angle.
    assert found[2] == pytest.approx((2**-1.25 - 0.00818) / (1 - 0.00818), rel=1e-3)
    np.testing.assert_allclose(found, [1, 0.513, found[2], 0.1843, 0.0277, 0, 0], atol=1e-4)


def test_every_pattern_shines_with_its_candelas_the_way_it_faces() -> None:
    lamps = [
        LightSource(pattern, (0, 0, 0), (0.0, 1.0, 0.0), 1000.0, (1, 1, 1))
        for pattern in LampPattern
    ]
    left = np.array([[0.0, math.cos(0.1), -math.sin(0.1)]])
    rays = np.repeat(left[None], len(lamps), axis=0)
    found = dict(zip(LampPattern, intensity_towards(lamps, rays)[:, 0], strict=True))
    down = ray(0.0, -math.degrees(0.1))
    mirrored = LOW_BEAM.mirror(), LED_LOW_BEAM.mirror()
    assert found == pytest.approx(
        {
            LampPattern.STREET: 1000 * math.cos(0.1),
            LampPattern.LOW_BEAM: 1000 * LOW_BEAM.relative_intensity(AHEAD, down)[0],
            LampPattern.LED_LOW_BEAM: 1000 * LED_LOW_BEAM.relative_intensity(AHEAD, down)[0],
            LampPattern.LENS: 1000 * LENS.relative_intensity(np.array(math.cos(0.1))),
            LampPattern.FOG_BEAM: 1000 * FRONT_FOG_BEAM.relative_intensity(AHEAD, down)[0],
            LampPattern.LEFT_HAND_LOW_BEAM: 1000 * mirrored[0].relative_intensity(AHEAD, down)[0],
            LampPattern.LEFT_HAND_LED_LOW_BEAM: (
                1000 * mirrored[1].relative_intensity(AHEAD, down)[0]
            ),
            # 0.1 rad below the axis.
            LampPattern.HIGH_BEAM: 1000 * math.exp(-((math.degrees(0.1) / 3.5) ** 2)),
        }
    )
    # Shaders know them.
    assert [pattern.value for pattern in LampPattern] == [0, 1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(("pattern", "left_hand"), LEFT_HAND_PATTERNS.items())
def test_low_beams_rise_to_the_near_side_of_the_road(
    pattern: LampPattern, left_hand: LampPattern
) -> None:
    """One degree up, 8 degrees aside, the near side is lit, and the oncoming one is dark."""
    near, oncoming = ray(8.0, 1.0), ray(-8.0, 1.0)
    (right, dark), (mirrored_dark, left) = (
        [BEAMS[kind].relative_intensity(AHEAD, way)[0] for way in (near, oncoming)]
        for kind in (pattern, left_hand)
    )
    assert right == pytest.approx(left)
    assert dark == pytest.approx(mirrored_dark)
    assert left > 10 * mirrored_dark
