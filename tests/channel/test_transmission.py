"""What becomes of messages, counted over many frames of five agents who stand still.

Seeds are fixed, so a test that passes always does; bounds are four standard errors.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Channel, Spec

from advercity.channel.propagation import PathState, RadioPath, compute_received_dbm
from advercity.channel.transmission import Air, V2xChannel
from advercity.dataset.message_documents import build_messages_document
from advercity.frames import STATE_DTYPE, Trace
from advercity.sensors.messages import Delivery, LossReason, MessageKind, SentMessages
from advercity.sensors.sensor_frame import SensorFrame
from advercity.testing import CAR, build_flat_world
from tests.builders import ACTORS, SensorFramesOf

NO_TRACE = Trace(0.1, 60, (), np.zeros(0, STATE_DTYPE), (), np.zeros((0, 0), np.uint8))
WORLD = build_flat_world(bodies={actor.blueprint: CAR for actor in ACTORS})
LINKS = 20
"""Of five agents, each to four others."""


@pytest.fixture(scope="module")
def scene(sensor_frames_of: SensorFramesOf) -> tuple[SensorFrame, ...]:
    return sensor_frames_of(0)


def open_channel(spec: Spec, **fields: Any) -> V2xChannel:
    channel = Channel.model_validate({"id": "tested", "cpm": None, **fields})
    return V2xChannel(spec.model_copy(update={"channel": channel}), channel, NO_TRACE, WORLD)


def send(opened: V2xChannel, scene: tuple[SensorFrame, ...], index: int) -> dict[str, SentMessages]:
    """Send the messages of a frame in which everything is as in the first one."""
    frame = replace(scene[0].frame, index=index, time_s=6.0 + 0.1 * index)
    return opened.send([replace(item, frame=frame) for item in scene], Air())


def list_deliveries(
    opened: V2xChannel, scene: tuple[SensorFrame, ...], frames: int
) -> list[Delivery]:
    return [
        delivery
        for index in range(frames)
        for sent in send(opened, scene, index).values()
        for message in sent.messages
        for delivery in message.deliveries.values()
    ]


def test_an_ideal_channel_delivers_everything_at_once(
    spec: Spec, scene: tuple[SensorFrame, ...]
) -> None:
    found = list_deliveries(open_channel(spec, cpm={}), scene, 3)
    assert found == [Delivery(delay_s=0.0)] * (3 * 2 * LINKS)


def test_the_declared_fraction_of_messages_is_lost(
    spec: Spec, scene: tuple[SensorFrame, ...]
) -> None:
    """0.2 of the time in bursts that lose 0.9, 0.05 of the rest: 0.22.

    Its variance is that of single messages, and that of the time in bursts of 0.3 s: 2 f (1 - f)
    tau / T on each of 20 links, with tau of 0.24 s.
    """
    loss = {"rate": 0.05, "burst_fraction": 0.2, "burst_s": 0.3, "burst_rate": 0.9}
    frames, total = 400, 0.22
    found = list_deliveries(open_channel(spec, loss=loss), scene, frames)
    assert len(found) == frames * LINKS
    lost = np.mean([delivery.lost is LossReason.CHANNEL for delivery in found])
    in_bursts = 0.85**2 * 2 * 0.2 * 0.8 * 0.24 / (0.1 * frames * LINKS)
    error = math.sqrt(total * (1 - total) / len(found) + in_bursts)
    assert Channel.model_validate({"id": "x", "loss": loss}).loss.total_rate == pytest.approx(total)
    assert lost == pytest.approx(total, abs=4 * error)
    assert error < 0.01


def test_delays_have_the_declared_minimum_and_mean(
    spec: Spec, scene: tuple[SensorFrame, ...]
) -> None:
    latency = {"minimum_s": 0.02, "jitter_s": 0.03}
    found = list_deliveries(open_channel(spec, latency=latency), scene, 200)
    delays_s = np.array([delivery.delay_s for delivery in found], np.float64)
    assert delays_s.min() >= 0.02
    assert delays_s.mean() == pytest.approx(0.05, abs=4 * 0.03 / math.sqrt(len(delays_s)))
    assert delays_s.std() == pytest.approx(0.03, rel=0.1)


def test_what_is_too_late_is_lost(spec: Spec, scene: tuple[SensorFrame, ...]) -> None:
    """Of exponential delays with a mean of 0.1 s over 0.05 s, exp(-0.5) exceed 0.1 s."""
    latency = {"minimum_s": 0.05, "jitter_s": 0.1}
    found = list_deliveries(open_channel(spec, latency=latency, lifetime_s=0.1), scene, 100)
    late = np.mean([delivery.lost is LossReason.LIFETIME for delivery in found])
    assert late == pytest.approx(math.exp(-0.5), abs=4 * 0.49 / math.sqrt(len(found)))
    assert max(delivery.delay_s or 0.0 for delivery in found) <= 0.1


def test_messages_wait_for_those_before_them(spec: Spec, scene: tuple[SensorFrame, ...]) -> None:
    """At 1 Mbit/s a CAM of 350 B takes 2.8 ms; a CPM of 121 B and six sensors of 35 B 2.65 ms."""
    opened = open_channel(spec, rate_mbit_s=1, cpm={"min_points": 1000})
    sent = send(opened, scene, 0)
    ends_s = {
        kind: sorted(
            delivery.delay_s or 0.0
            for item in sent.values()
            for message in item.messages
            if message.kind is kind
            for delivery in message.deliveries.values()
        )
        for kind in (MessageKind.CAM, MessageKind.CPM)
    }
    cams_s = np.repeat(np.arange(1, 6) * 2.8e-3, 4)
    sizes = {m.size_bytes for one in sent.values() for m in one.messages if m.objects is not None}
    assert sizes == {121 + 5 * 35}
    cpms_s = 5 * 2.8e-3 + np.repeat(np.arange(1, 6) * 296 * 8e-6, 4)
    assert ends_s[MessageKind.CAM] == pytest.approx(cams_s)
    assert ends_s[MessageKind.CPM] == pytest.approx(cpms_s)


def test_what_the_medium_cannot_carry_is_given_up(
    spec: Spec, scene: tuple[SensorFrame, ...]
) -> None:
    """After 14 ms of CAM, 80 ms of data fit into a period once, whoever's turn it is."""
    opened = open_channel(spec, rate_mbit_s=1, data={"size_bytes": 10_000})
    senders: set[str] = set()
    for index in range(12):
        reasons = {
            name: message.deliveries["rsu1" if name != "rsu1" else "rsu2"].lost
            for name, sent in send(opened, scene, index).items()
            for message in sent.messages
            if message.kind is MessageKind.DATA
        }
        served = [name for name, lost in reasons.items() if lost is None]
        assert len(served) == 1
        assert list(reasons.values()).count(LossReason.QUEUE) == 4
        senders.update(served)
    assert len(senders) >= 4


def test_nothing_arrives_beyond_the_range(spec: Spec, scene: tuple[SensorFrame, ...]) -> None:
    """The ego and cav2 are 22.8 m apart, and 1.4 mm more or less makes the difference."""
    distance_m = math.hypot(22.0, 6.0)
    for range_m, lost in ((distance_m + 1e-3, None), (distance_m - 1e-3, LossReason.RANGE)):
        sent = send(open_channel(spec, range_m=range_m), scene, 0)
        (message,) = sent["cav1"].messages
        assert message.deliveries["cav2"].lost is lost


def test_the_received_power_is_that_of_the_link_budget_alike_in_both_directions(
    spec: Spec, scene: tuple[SensorFrame, ...]
) -> None:
    """The van is beside the line of sight; nothing else is near it."""
    opened = open_channel(spec, radio={"shadowing": False, "environment": "urban"})
    sent = send(opened, scene, 0)
    there, back = (
        sent[one].messages[0].deliveries[other]
        for one, other in (("cav1", "rsu2"), ("rsu2", "cav1"))
    )
    assert there == back
    ego, *_, unit = scene
    antenna = ego.world_from_agent[:3, 3] + (0, 0, 1.51 + 0.1)
    distance_m = float(np.linalg.norm(antenna - unit.world_from_agent[:3, 3]))
    radio = Channel.model_validate({"id": "x", "radio": {"shadowing": False}}).radio
    assert radio is not None
    path = RadioPath(PathState.LOS, distance_m, (0.0, 0.0))
    power = compute_received_dbm(radio, path, "urban")
    assert (there.path, there.power_dbm) == ("los", pytest.approx(power))
    deaf = {"shadowing": False, "environment": "urban", "sensitivity_dbm": power + 0.01}
    found = send(open_channel(spec, radio=deaf), scene, 0)["cav1"].messages[0].deliveries["rsu2"]
    assert found.lost is LossReason.POWER


def test_frames_give_the_same_messages_in_any_order(
    spec: Spec, scene: tuple[SensorFrame, ...]
) -> None:
    fields: dict[str, Any] = {
        "radio": {},
        "rate_mbit_s": 6,
        "latency": {"jitter_s": 0.1},
        "loss": {"rate": 0.1, "burst_fraction": 0.3},
        "pose_error": {"white_noise_m": 1, "wander_m": 1, "heading_noise_deg": 1},
        "clock": {"offset_s": 0.1},
        "cpm": {"range_noise_m": 0.3},
        "data": {"period_s": 0.3},
    }
    orders = (range(8), range(7, -1, -1))
    documents = [
        {
            index: {
                name: build_messages_document(scene[0].frame, sent)
                for name, sent in send(opened, scene, index).items()
            }
            for index in order
        }
        for opened, order in zip(
            (open_channel(spec, **fields) for _ in orders), orders, strict=True
        )
    ]
    assert documents[0] == documents[1]
    assert documents[0][0] != documents[0][1]


def test_a_limit_leaves_the_luck_of_the_other_messages(
    spec: Spec, scene: tuple[SensorFrame, ...]
) -> None:
    loss, latency = {"rate": 0.3}, {"jitter_s": 0.01}
    free = list_deliveries(open_channel(spec, loss=loss, latency=latency), scene, 5)
    near = list_deliveries(open_channel(spec, loss=loss, latency=latency, range_m=25), scene, 5)
    reached = [row for row, item in enumerate(near) if item.lost is not LossReason.RANGE]
    assert 0 < len(reached) < len(near)
    assert [near[row] for row in reached] == [free[row] for row in reached]


def test_every_agent_sends_once_in_its_period(spec: Spec, scene: tuple[SensorFrame, ...]) -> None:
    opened = open_channel(spec, cam={"period_s": 0.4})
    sending = np.array(
        [[len(sent.messages) for sent in send(opened, scene, index).values()] for index in range(8)]
    )
    np.testing.assert_array_equal(sending[:4].sum(axis=0), 1)
    np.testing.assert_array_equal(sending[:4], sending[4:])
    # Not all in the same tick.
    assert (sending[:4].sum(axis=1) < 5).all()
