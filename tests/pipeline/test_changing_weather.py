"""Scenarios whose weather changes from frame to frame."""

from pathlib import Path

import pytest
import yaml
from advercity_dsl import Spec

from advercity.compiler import find_weather, with_weather
from advercity.dataset.facts import collect_scenario_facts
from advercity.dataset.manifest import Manifest
from advercity.dataset.reader import Scenario
from advercity.physics.timeline import WeatherTimeline
from advercity.pipeline import RunOptions, run_scenario
from advercity.sensors.camera.weather import CameraWeather
from advercity.sensors.lidar import derive_lidar_conditions
from advercity.testing import hash_tree, load_example_spec, with_small_sensors

pytestmark = pytest.mark.sumo


@pytest.fixture(scope="module")
def spec(library: Path) -> Spec:
    """A shower that passes."""
    shower = find_weather(str(library / "examples" / "passing_shower.yaml"))
    return with_small_sensors(with_weather(load_example_spec("rsnj_clear_day_sparse"), shower))


def run(spec: Spec, output: Path, frames: slice) -> Path:
    return run_scenario(spec, RunOptions(output, backend="fake", profile="preview", frames=frames))


def test_every_order_of_frames_gives_the_same_files(spec: Spec, tmp_path: Path) -> None:
    at_once = run(spec, tmp_path / "once", slice(40, 121, 40))
    for first in (120, 40, 80):
        by_parts = run(spec, tmp_path / "parts", slice(first, first + 1))

    assert hash_tree(by_parts) == hash_tree(at_once)


def test_each_frame_says_its_weather(spec: Spec, tmp_path: Path) -> None:
    made = run(spec, tmp_path, slice(0, 101, 70))
    (first, later) = sorted((made / "102").glob("000???.yaml"))

    assert Manifest.load(made).weather.rain_mm_h == 0
    assert yaml.safe_load(first.read_text())["weather"]["rain_mm_h"] == 0
    weather = yaml.safe_load(later.read_text())["weather"]
    # At 7 s, halfway between 4 and 10 s.
    assert (weather["rain_mm_h"], weather["wind_m_s"], weather["time"]) == (20, 7.2, "day")
    rates = [weather.rain_mm_h for weather in collect_scenario_facts(Scenario(made)).weathers]
    assert rates == [0, 20]


def test_constant_weather_is_in_the_manifest_alone(tmp_path: Path) -> None:
    constant = with_small_sensors(load_example_spec("rsnj_clear_day_sparse"))
    made = run(constant, tmp_path, slice(0, 1))

    assert "weather" not in yaml.safe_load((made / "102" / "000060.yaml").read_text())


def test_each_frame_has_as_many_drops_as_its_rain(spec: Spec) -> None:
    timeline = WeatherTimeline(spec.weather, spec.timing.tick_s)
    cameras = CameraWeather(spec, timeline)
    none, some, most = (cameras.at(frame) for frame in (10, 70, 120))

    dry, weather = timeline.atmosphere_at(10, spec.road.land_use), timeline.weather_at(10)
    assert not none.blocks
    assert not derive_lidar_conditions(dry, weather.lens).extinction.precipitation
    # Most is the rain of 40 mm/h that blocks are built for; of drops of 1 mm, 20 mm/h has
    # exp(-4.1 (20^-0.21 - 40^-0.21)) = 0.744 times as many.
    (shown,) = [block.shown for block in some.blocks if block.band.low_mm == pytest.approx(0.9)]
    assert shown == pytest.approx(0.744, abs=0.005)
    assert {block.shown for block in most.blocks} == {1.0}
    assert cameras.at(70).blocks[0].offset_m is some.blocks[0].offset_m
