"""People who set foot on a roadway are counted, and as many do as a road declares."""

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from advercity_dsl import Spec

from advercity.conflicts.crossing_people import measure_crossing_share
from advercity.conflicts.report import build_traffic_report
from advercity.frames import STATE_DTYPE, Actor, Trace

SIZE = (0.5, 0.5, 1.7)


def test_the_share_is_of_background_pedestrians_who_are_on_the_roadway_once(
    specs: dict[str, Spec],
):
    """Of four in the background one crosses; the staged one and a car do not count."""
    spec = specs["unj_clear_day_sparse"]
    staged = spec.conflicts[0].actors[0].number
    actors = [Actor(5001 + i, "pedestrian", "person", "cloth_red", SIZE) for i in range(4)]
    actors += [Actor(staged, "pedestrian", "person", "cloth_red", SIZE)]
    actors += [Actor(1001, "car", "sedan", "car_paint_red", (4.0, 1.8, 1.5))]
    states = np.zeros(2 * len(actors), dtype=STATE_DTYPE)
    states["tick"] = np.repeat([0, 1], len(actors))
    states["actor"] = np.tile(np.arange(len(actors)), 2)
    states["y"] = [5, 5, 5, 5, 0, 0, 5, 0, 5, 5, 0, 0]
    trace = Trace(0.1, 59, tuple(actors), states, (), np.zeros((2, 0), np.uint8))
    roadway = shapely.box(-3, -3, 3, 3)

    assert measure_crossing_share(spec, trace, roadway) == 1 / 4
    alone = trace.states[trace.states["actor"] >= 4].copy()
    alone["actor"] -= 4
    others = Trace(0.1, 59, tuple(actors[4:]), alone, (), trace.signals)
    assert measure_crossing_share(spec, others, roadway) is None


@pytest.mark.sumo
@pytest.mark.parametrize(
    "name",
    [
        "unj_clear_day_sparse",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("unj_clear_day_dense", "ui_clear_day_sparse", "ui_clear_day_dense")
        ),
    ],
)
def test_about_as_many_people_cross_as_the_road_declares(
    name: str, specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    spec = specs[name]
    report = build_traffic_report(spec, simulate(spec), "")

    assert spec.demand.crossing_share == 0.2
    assert report.crossing_share == pytest.approx(0.2, abs=0.03)
    assert report.to_document()["crossing_share"] == report.crossing_share
    assert report.overlaps == ()
