"""Lamps in fog by night against path tracers of the whole phase function.

Expected luminances are `python benchmarks/night_fog.py --mor 63`'s reference, in cd/m².
"""

import importlib.util
import math

import pytest

from benchmarks import night_fog
from benchmarks.night_fog import Pack, list_scenes, render_patch

pytestmark = pytest.mark.render

MOR_M = 63.0
REFERENCE = {
    "card, 20 m": 2.96,
    "adjacent air, 20 m": 0.312,
    "card, 40 m": 0.397,
    "adjacent air, 40 m": 0.239,
    "own beams, 4 to 6 degrees up": 0.113,
    "own beams, 4 degrees down": 0.475,
    "oncoming, 5 degrees off": 1.22,
    "crossing, in front": 0.0614,
    "street lamp, 5 degrees off": 2.12,
    "road before a street lamp": 1.45,
    "card under a street lamp": 2.61,
}
SCENES = {scene.name: scene for scene in list_scenes()}


@pytest.mark.parametrize("name", list(REFERENCE))
def test_what_is_seen_in_fog_by_night_is_as_bright_as_the_reference(name: str) -> None:
    """The reference has an error of 3 %."""
    found = render_patch(SCENES[name], MOR_M, "raster", width_px=160, samples=1)
    assert found == pytest.approx(REFERENCE[name], rel=0.2 if SCENES[name].street else 0.15)


@pytest.mark.parametrize("name", ["card, 20 m", "adjacent air, 20 m", "crossing, in front"])
def test_traced_pictures_of_fog_by_night_are_as_bright_as_the_reference(name: str) -> None:
    found = render_patch(SCENES[name], MOR_M, "ray_traced", width_px=48, samples=32)
    assert found == pytest.approx(REFERENCE[name], rel=0.1)


@pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None,
    reason="the reference is not compared with Mitsuba; `scripts/setup_peers` installs it",
)
@pytest.mark.parametrize(
    "name", ["card, 20 m", "oncoming, 5 degrees off", "street lamp, 5 degrees off"]
)
def test_light_that_turns_once_is_the_same_in_the_reference_and_in_mitsuba(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More often needs millions of Mitsuba's paths; its lamps end at 88 degrees."""
    monkeypatch.setattr(night_fog, "MAX_SCATTERINGS", 1)
    expected, their_error = night_fog.trace_with_mitsuba(SCENES[name], MOR_M, 100_000, max_depth=2)
    found, error = night_fog.trace_reference(SCENES[name], MOR_M, 40_000)
    noise = math.hypot(error, their_error)
    assert noise < 0.1 * expected
    assert found == pytest.approx(expected, rel=0.03, abs=3.0 * noise)


@pytest.mark.parametrize("pack", ["raster", "ray_traced"])
def test_a_pedestrian_in_the_own_beams_is_lost_at_the_distance_of_the_reference(pack: Pack) -> None:
    """A card of 0.6 x 1.7 m against the adjacent air: 0.66 at 40 m."""
    card, air = (
        render_patch(SCENES[f"{what}, 40 m"], MOR_M, pack, width_px=64, samples=16)
        for what in ("card", "adjacent air")
    )
    assert card / air - 1.0 == pytest.approx(0.66, abs=0.15)
