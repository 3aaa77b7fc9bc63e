"""A long trace of messages in files, measured by `stats`, against what its channel declares.

Seeds are fixed, so a test that passes always does; bounds are four standard errors.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Channel, Spec

from advercity.channel.transmission import Air, V2xChannel
from advercity.dataset.facts import ScenarioFacts, collect_scenario_facts
from advercity.dataset.reader import Scenario
from advercity.dataset.statistics import compute_tables
from advercity.frames import STATE_DTYPE, Trace
from advercity.sensors.sensor_frame import SensorFrame
from advercity.testing import CAR, build_flat_world
from tests.builders import ACTORS, SensorFramesOf, write_scenario

FRAMES = 100
LINKS = 20
CHANNEL: dict[str, Any] = {
    "id": "measured",
    "latency": {"minimum_s": 0.05, "jitter_s": 0.1},
    "lifetime_s": 5,
    "loss": {"rate": 0.05, "burst_fraction": 0.2, "burst_s": 0.3},
    "pose_error": {"white_noise_m": 0.4, "heading_noise_deg": 2},
    "cpm": None,
}


def without_images(item: SensorFrame) -> SensorFrame:
    """Leave out images, which would take most of the time; messages do not need them."""
    sensors = item.agent.sensors
    camera = sensors.cameras[0].model.model_copy(
        update={"mounts": sensors.cameras[0].model.mounts[:1]}
    )
    agent = item.agent.model_copy(update={"sensors": sensors.model_copy(update={"camera": camera})})
    return replace(item, agent=agent).with_readings(camera=item.camera_images[:1])


@pytest.fixture(scope="module")
def facts(
    spec: Spec, sensor_frames_of: SensorFramesOf, tmp_path_factory: pytest.TempPathFactory
) -> ScenarioFacts:
    scene = [without_images(item) for item in sensor_frames_of(0)]
    channel = Channel.model_validate(CHANNEL)
    changes = {"channel": channel, "agents": tuple(item.agent for item in scene)}
    sending = spec.model_copy(update=changes)
    trace = Trace(0.1, 60, (), np.zeros(0, STATE_DTYPE), (), np.zeros((0, 0), np.uint8))
    world = build_flat_world(bodies={actor.blueprint: CAR for actor in ACTORS})
    opened = V2xChannel(sending, channel, trace, world)

    def send(index: int) -> tuple[SensorFrame, ...]:
        frame = replace(scene[0].frame, index=index, time_s=6.0 + 0.1 * index)
        moved = [replace(item, frame=frame) for item in scene]
        sent = opened.send(moved, Air())
        return tuple(replace(item, sent=sent[item.agent.id]) for item in moved)

    root: Path = tmp_path_factory.mktemp("measured")
    # The original's layout has no maps, whose drawing would take most of the time.
    written = write_scenario(root, sending, send, frames=FRAMES, format="adver_city")
    return collect_scenario_facts(Scenario(written))


@pytest.fixture(scope="module")
def row(facts: ScenarioFacts) -> dict[str, Any]:
    (table,) = (one for one in compute_tables([facts]) if one.name == "messages")
    (values,) = table.rows
    return dict(zip(table.columns, values, strict=True))


def test_the_fraction_lost_is_the_declared_one(row: dict[str, Any]) -> None:
    """0.2 + 0.8 x 0.05 is 0.24; bursts of 0.3 s and pauses of 1.2 s correlate over 0.24 s."""
    assert (row["kind"], row["messages"]) == ("cam", FRAMES * LINKS)
    bursts = 0.95**2 * 2 * 0.2 * 0.8 * 0.24 / (0.1 * FRAMES * LINKS)
    error = math.sqrt(0.24 * 0.76 / (FRAMES * LINKS) + bursts)
    assert row["lost_channel"] == pytest.approx(0.24, abs=4 * error)
    assert row["received"] + row["lost_channel"] == pytest.approx(1.0)


def test_delays_are_the_declared_ones(row: dict[str, Any]) -> None:
    """The 95 % quantile of an exponential distribution is ln 20 of its mean.

    Its density there is 0.05 over the mean.
    """
    count = row["received"] * row["messages"]
    assert row["delay_s_mean"] == pytest.approx(0.15, abs=4 * 0.1 / math.sqrt(count))
    assert row["delay_s_95_percent"] == pytest.approx(
        0.05 + 0.1 * math.log(20), abs=4 * math.sqrt(0.05 * 0.95 / count) / (0.05 / 0.1)
    )


def test_poses_err_by_the_declared_deviation(row: dict[str, Any]) -> None:
    """Three of five agents are vehicles: of all messages 3/5 err by 0.4 m in x and in y."""
    assert row["position_error_m_rms"] == pytest.approx(0.4 * math.sqrt(2 * 3 / 5), rel=0.1)
    assert row["heading_error_deg_rms"] == pytest.approx(2 * math.sqrt(3 / 5), rel=0.15)


def test_the_newest_message_is_as_old_as_loss_and_delays_make_it(
    facts: ScenarioFacts, row: dict[str, Any]
) -> None:
    """The newest is at least as old as n ticks if none of the last n has arrived.

    Without bursts, the mean would be a tick times the sum over n of the product over k < n of
    1 - 0.76 F(0.1 k s), with F the distribution of delays: 1 + 0.701 + 0.287 + 0.087 + 0.024 +
    0.006 + 0.002 ticks. Bursts make it older.
    """
    arrived = [0.76 * (1 - math.exp(-(0.1 * k - 0.05) / 0.1)) if k else 0.0 for k in range(60)]
    alone_s = 0.1 * sum(np.cumprod(1 - np.array(arrived)).tolist())
    assert alone_s == pytest.approx(0.2107, abs=5e-4)
    settled = facts.message_ages[facts.message_ages["frame"] > 30]
    assert settled["age_s"].min() == pytest.approx(0.1)
    assert alone_s < settled["age_s"].mean() < alone_s + 0.3 * 0.2 * 2
    assert row["ego_age_s_mean"] == pytest.approx(facts.message_ages["age_s"].mean())


def test_every_distance_counts_the_messages_that_arrive_there(facts: ScenarioFacts) -> None:
    (table,) = (one for one in compute_tables([facts]) if one.name == "messages_by_range")
    fractions = np.array(table.columns["fog_day"])
    near = facts.messages["distance_m"] < 20
    assert fractions[0] == pytest.approx(np.mean(facts.messages["lost"][near] == ""))
    assert np.isnan(fractions[5:]).all()
