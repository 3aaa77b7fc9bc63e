"""Beams in fog by night against a backward Monte Carlo of the whole phase function.

Expected luminances are `python benchmarks/night_fog.py --mor 63`'s reference, in cd/m².
"""

import pytest

from benchmarks.night_fog import Pack, list_scenes, render_patch

pytestmark = pytest.mark.render

MOR_M = 63.0
REFERENCE = {
    "card, 20 m": 2.75,
    "adjacent air, 20 m": 0.298,
    "card, 40 m": 0.360,
    "adjacent air, 40 m": 0.226,
    "own beams, 4 to 6 degrees up": 0.116,
    "own beams, 13 to 16 degrees up": 0.0448,
    "oncoming, 5 degrees off": 1.26,
}
SCENES = {scene.name: scene for scene in list_scenes()}


@pytest.mark.parametrize("name", list(REFERENCE))
def test_what_is_seen_in_fog_by_night_is_as_bright_as_the_reference(name: str) -> None:
    """The reference has an error of 2 to 9 %, and glow near the own beams is 17 % too dark."""
    found = render_patch(SCENES[name], MOR_M, "raster", width_px=160, samples=1)
    assert found == pytest.approx(REFERENCE[name], rel=0.2)


@pytest.mark.parametrize("pack", ["raster", "ray_traced"])
def test_a_pedestrian_in_the_own_beams_is_lost_at_the_distance_of_the_reference(pack: Pack) -> None:
    """A card of 0.6 x 1.7 m against the adjacent air: 0.6 at 40 m."""
    card, air = (
        render_patch(SCENES[f"{what}, 40 m"], MOR_M, pack, width_px=64, samples=16)
        for what in ("card", "adjacent air")
    )
    assert card / air - 1.0 == pytest.approx(0.59, abs=0.25)
