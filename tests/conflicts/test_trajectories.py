"""Where the paths of the ego and of an actor meet."""

import numpy as np
import pytest
import shapely

from advercity.conflicts.metrics import ActorTrack
from advercity.conflicts.trajectories import find_crossing
from advercity.frames import STATE_DTYPE

STREET = shapely.LineString([(-50.0, 0.0), (50.0, 0.0)])


@pytest.mark.parametrize(
    ("slope", "meets_m"),
    [
        # 0.5 m from the street 10 m before it crosses it: from there on both are in one lane.
        (0.05, -10.0),
        # 0.5 m from it 1 m before.
        (0.5, 0.0),
    ],
)
def test_paths_that_run_together_meet_where_they_join(slope: float, meets_m: float):
    rows = np.zeros(401, STATE_DTYPE)
    rows["x"] = np.linspace(-20.0, 20.0, 401)
    rows["y"] = -slope * rows["x"]
    ego = ActorTrack(101, np.array([4.0, 2.0]), rows)

    found = find_crossing(STREET, ego, (-5.0, 0.0))

    assert found == pytest.approx([meets_m, 0.0], abs=0.15)
