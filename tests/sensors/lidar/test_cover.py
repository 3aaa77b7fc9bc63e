"""Rain, water and snow stay off what is under a deck."""

import numpy as np
import pytest

from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.rendering.cover import Cover
from advercity.semantics import Semantic
from advercity.sensors.lidar import cast_scan
from advercity.sensors.measurements import PointCloud, PointKind
from advercity.testing import build_box
from tests.sensors.lidar.builders import EXACT, ground, measure, raycaster_of

DECK = build_box((20.0, 12.0, 1.0), (25.0, 0.0, 5.5), material="concrete", semantic=Semantic.BRIDGE)
"""From 15 to 35 m ahead, 6 m to either side, 5 to 6 m up."""
RAIN = {"rain": {"rate_mm_h": 50}, "surface": {"wetness": 1, "puddle_coverage": 0.4}}


EDGE = pose_matrix((13, 0, 1.9))
"""A LiDAR 2 m before the deck."""


def is_under(points: np.ndarray) -> np.ndarray:
    """Whether points in the frame of that LiDAR are under the deck."""
    return (points[:, 0] > 2) & (points[:, 0] < 22) & (np.abs(points[:, 1]) < 6)


def scan_rain(*static: Mesh, times: int = 4) -> list[PointCloud]:
    caster = raycaster_of(ground("asphalt"), *static)
    scan = cast_scan(EXACT, EDGE, caster, puddle_coverage=0.4)
    return [measure(EXACT, scan, number, **RAIN) for number in range(times)]


def test_cover_is_below_a_deck_and_not_on_it_or_beside_it() -> None:
    cover = Cover.from_meshes([DECK])
    assert cover is not None
    points = np.array(
        [
            (25, 0, 0),
            (15.1, 5.9, 4.9),
            (25, 0, 5.0),
            (25, 0, 6.0),
            (25, 0, 7),
            (14.9, 0, 1),
            (25, 6.1, 1),
        ]
    )
    expected = [True, True, True, False, False, False, False]
    assert cover.find_covered(points).tolist() == expected
    assert Cover.from_meshes([ground()]) is None


def test_no_drop_returns_from_under_a_deck() -> None:
    outside, inside = (
        np.concatenate([cloud.points[cloud.kind == PointKind.RAIN] for cloud in clouds])
        for clouds in (scan_rain(), scan_rain(DECK))
    )
    assert is_under(outside).sum() > 20
    assert not is_under(inside).any()
    # Elsewhere the same drops fall.
    assert (inside[:, 0] < 0).sum() == (outside[:, 0] < 0).sum() > 100


def test_the_ground_under_a_deck_is_dry() -> None:
    (wet,), (covered,) = scan_rain(times=1), scan_rain(DECK, times=1)
    caster = raycaster_of(ground("asphalt"), DECK)
    dry = measure(EXACT, cast_scan(EXACT, EDGE, caster), air={"mor_m": None})
    seen = [
        cloud.intensity[
            (cloud.semantic == Semantic.ROAD)
            & (cloud.kind == PointKind.SURFACE)
            & is_under(cloud.points)
            & (cloud.points[:, 0] < 12)
        ]
        for cloud in (wet, covered, dry)
    ]
    assert len(seen[1]) > 1.3 * len(seen[0])
    # Rain in the air takes some of the light.
    assert seen[1].mean() == pytest.approx(seen[2].mean(), rel=0.1)
    assert seen[0].mean() < 0.7 * seen[2].mean()


def test_snow_stays_off_the_ground_under_a_deck() -> None:
    snow = {
        "snow": {"depth_mm": 100, "road_coverage": 1, "rut_coverage": 1},
        "temperature_c": -3,
    }
    seen: list[float] = []
    for static in ((), (DECK,)):
        caster = raycaster_of(ground("asphalt"), *static)
        scan = cast_scan(EXACT, pose_matrix((25, 0, 1.9)), caster)
        found = measure(EXACT, scan, **snow)
        near = np.hypot(*found.points[:, :2].T) < 5.5
        seen.append(float(found.intensity[(found.semantic == Semantic.ROAD) & near].mean()))
    assert seen[1] < 0.3 * seen[0]
