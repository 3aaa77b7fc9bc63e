"""Drivers who react to weather, and those who do not."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import DriverResponse, Spec
from numpy.typing import NDArray

from advercity.compiler import find_weather, to_json, with_weather
from advercity.compiler.crossing import compile_library
from advercity.conflicts.metrics import ActorTrack
from advercity.conflicts.outcome import evaluate_outcomes
from advercity.frames import Trace
from advercity.pipeline.cache import compute_traffic_key

SUITE = """
kind: suite
id: {id}
roads: [unj, ri]
weathers: [clear_day, soft_rain_day, fog_day, foggy_heavy_rain_day, snow_day]
densities: [sparse]
stage: {{unj: [ped_farside_crossing], ri: [ltap_od_ego_turns, cyc_nearside_obstructed]}}
rig: adver_city
catalogue: adver_city
{drivers}
"""
FOLLOWING_M = 30.0
Simulated = Callable[[Spec], Trace]


@pytest.fixture(scope="module")
def copied(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped library with snow, and suites with drivers of either kind."""
    folder = tmp_path_factory.mktemp("drivers") / "library"
    shutil.copytree(library, folder)
    shutil.copy(folder / "examples" / "snow_day.yaml", folder / "nhtsa" / "weather")
    for name, drivers in (("steady", ""), ("wary", "drivers: wary")):
        text = SUITE.format(id=name, drivers=drivers)
        (folder / "nhtsa" / "suites" / f"{name}.yaml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def steady(copied: Path) -> dict[str, Spec]:
    """Specs with drivers who drive alike in any weather."""
    return {spec.id: spec for spec in compile_library(copied, suite="steady")}


@pytest.fixture(scope="module")
def wary(copied: Path) -> dict[str, Spec]:
    """The same with drivers who react."""
    return {spec.id: spec for spec in compile_library(copied, suite="wary")}


def test_a_spec_says_nothing_of_drivers_who_do_not_react(steady: dict[str, Spec]):
    text = to_json(steady["ri_snow_day_sparse"])

    assert '"drivers"' not in text
    assert '"caution"' not in text


def test_weathers_are_pairs_unless_drivers_react(steady: dict[str, Spec], wary: dict[str, Spec]):
    weathers = ("clear_day", "soft_rain_day", "fog_day", "foggy_heavy_rain_day", "snow_day")

    assert len({compute_traffic_key(steady[f"ri_{weather}_sparse"]) for weather in weathers}) == 1
    assert len({compute_traffic_key(wary[f"ri_{weather}_sparse"]) for weather in weathers}) == 5


def test_caution_is_read_from_the_tables(wary: dict[str, Spec]):
    # 4 mm/h lie 1.5 / 3.9 of the way from 10 to 13 % and from 0.04 to 0.15 s; 0.7 wet holds 0.56.
    assert wary["ri_soft_rain_day_sparse"].caution == DriverResponse(
        speed_share=0.8885, headway_s=0.082, usual_m_s2=2.747, hardest_m_s2=5.494
    )
    # 75 m lie 125 / 150 of the way from 10 to 20 %; a wetness of 0.05 leaves 0.785.
    assert wary["ri_fog_day_sparse"].caution == DriverResponse(
        speed_share=0.8167, headway_s=0.26, usual_m_s2=3.85, hardest_m_s2=7.701
    )
    # A road of which 60 % are white counts, not the milder snowfall; ruts hold 0.8 x 0.71 + 0.05.
    assert wary["ri_snow_day_sparse"].caution == DriverResponse(
        speed_share=0.8182, headway_s=0.438, usual_m_s2=3.031, hardest_m_s2=6.063
    )


def test_the_strongest_of_what_comes_together_counts(wary: dict[str, Spec]):
    both = wary["ri_foggy_heavy_rain_day_sparse"].caution

    assert both is not None
    assert (both.speed_share, both.headway_s) == (0.75, 0.31)


def test_a_replay_under_another_weather_is_what_the_suite_compiles(
    copied: Path, wary: dict[str, Spec]
):
    snow = find_weather(str(copied / "nhtsa" / "weather" / "snow_day.yaml"))

    assert with_weather(wary["ri_fog_day_sparse"], snow) == wary["ri_snow_day_sparse"]


@pytest.mark.sumo
def test_wary_drivers_drive_as_all_others_in_clear_weather(
    steady: dict[str, Spec], wary: dict[str, Spec], simulate: Simulated
):
    name = "ri_clear_day_sparse"

    np.testing.assert_array_equal(simulate(wary[name]).states, simulate(steady[name]).states)


@pytest.mark.sumo
@pytest.mark.parametrize(("road", "farther_s"), [("unj", 0.3), ("ri", 0.0)])
def test_traffic_is_slower_and_farther_apart_in_snow(
    road: str, farther_s: float, wary: dict[str, Spec], simulate: Simulated
):
    """Few drivers of `ri` follow others, and each has a headway of its own."""
    clear, snow = (
        simulate(wary[f"{road}_{weather}_sparse"]) for weather in ("clear_day", "snow_day")
    )

    assert 0.75 < _pace(snow) / _pace(clear) < 0.95
    assert _headway(snow) > _headway(clear) + farther_s
    assert len(snow) > len(clear)


@pytest.mark.sumo
@pytest.mark.parametrize("name", ["unj_snow_day_sparse", "ri_snow_day_sparse"])
def test_conflicts_happen_although_drivers_react(
    name: str, wary: dict[str, Spec], simulate: Simulated
):
    staged = list(evaluate_outcomes(wary[name], simulate(wary[name])))

    assert staged
    assert [one.missed for one in staged] == [()] * len(staged)


ARRIVING_SNOW = """
kind: weather
id: arriving_snow
extends: clear_day
temperature_c: -3
keyframes:
  - {at_s: 4, snow: {road_coverage: 0, rut_coverage: 0}}
  - {at_s: 6, snow: {road_coverage: 60 %, rut_coverage: 20 %}}
"""


@pytest.mark.sumo
def test_drivers_react_to_snow_from_the_moment_it_lies(
    copied: Path, wary: dict[str, Spec], simulate: Simulated
):
    file = copied / "nhtsa" / "weather" / "arriving_snow.yaml"
    file.write_text(ARRIVING_SNOW)
    spec = with_weather(wary["ri_clear_day_sparse"], find_weather(str(file)))
    clear, snow = simulate(wary["ri_clear_day_sparse"]), simulate(spec)

    assert spec.caution == wary["ri_clear_day_sparse"].caution
    # A cover of 60 % slows by 18 % (see above); ruts hold 0.8 x 0.8 + 0.25 x 0.2 without rain.
    last = spec.caution_changes[-1]
    assert (last.at_s, last.speed_share, last.hardest_m_s2) == (6, 0.8182, 6.769)
    # Motion is smoothed over ticks, and staged actors are timed for what comes.
    np.testing.assert_array_equal(_list_early_states(clear), _list_early_states(snow))
    assert _pace(snow) < 0.97 * _pace(clear)


def _list_early_states(trace: Trace) -> NDArray[np.void]:
    """List the states of unstaged actors in the first three seconds."""
    unstaged = [index for index, actor in enumerate(trace.actors) if actor.id < 4000]
    states = trace.states[trace.states["tick"] < 30]
    return states[np.isin(states["actor"], unstaged)]


def _drivers(trace: Trace) -> Iterator[ActorTrack]:
    for actor in trace.actors:
        if actor.actor_class not in ("pedestrian", "bicycle") and actor.id < 5000:
            yield ActorTrack.from_trace(trace, actor.id)


def _pace(trace: Trace) -> float:
    """Mean speed of all vehicles while they move, m/s."""
    speeds = np.concatenate([track.rows["speed"] for track in _drivers(trace)])
    return float(speeds[speeds > 1.0].mean())


def _headway(trace: Trace) -> float:
    """Median time between vehicles that follow each other, bumper to bumper, in seconds."""
    found: list[float] = []
    tracks = list(_drivers(trace))
    for tick in range(0, len(trace), 5):
        now = [track.at_ticks(np.array([tick])) for track in tracks if tick in track.rows["tick"]]
        found += [gap for one in now if (gap := _gap_s(one, now)) is not None]
    return float(np.median(found))


def _gap_s(one: ActorTrack, others: list[ActorTrack]) -> float | None:
    """Time to the nearest vehicle ahead in the same lane; None for those who stand or lead."""
    speed = float(one.rows["speed"][0])
    gaps: list[float] = []
    for other in others:
        forward, left = (other.centres[0] - one.centres[0]) @ one.axes[0].T
        if (
            0 < forward < FOLLOWING_M
            and abs(left) < 1.2
            and one.axes[0, 0] @ other.axes[0, 0] > 0.95
        ):
            gaps.append(forward - (one.size[0] + other.size[0]) / 2)
    return min(gaps) / speed if gaps and speed > 3.0 else None
