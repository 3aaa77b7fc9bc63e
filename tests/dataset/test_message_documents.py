"""Messages in files: mirrored as other documents are, and read as they were sent."""

import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Channel, Spec

from advercity.dataset.message_documents import build_messages_document
from advercity.dataset.plain_documents import format_json
from advercity.dataset.reader import Scenario
from advercity.dataset.received_messages import load_sent_messages
from advercity.geometry.poses import pose_matrix
from advercity.sensors.messages import (
    Delivery,
    LossReason,
    Message,
    MessageKind,
    PerceivedObjects,
    SentMessages,
    StationData,
)
from advercity.testing import make_frame
from tests.builders import SensorFramesOf, write_scenario

STATION = StationData(
    station_type=8,
    world_from_station=pose_matrix((10.0, 20.0, 1.0), yaw=math.radians(30)),
    position_sd_m=(1.0, 1.0, 2.0),
    heading_sd_rad=math.radians(0.5),
    speed_m_s=7.0,
    acceleration_m_s2=-1.5,
    yaw_rate_rad_s=math.radians(4),
    size_m=(8.0, 2.5, 3.5),
)
OBJECTS = PerceivedObjects(
    ids=np.array([7]),
    classes=np.array(["car"]),
    centres=np.array([[30.0, 5.0, 0.75]]),
    headings_rad=np.radians([90.0]),
    sizes_m=np.array([[4.0, 2.0, 1.5]]),
    velocities_m_s=np.array([[1.0, 9.0]]),
    position_covariances_m2=np.array([[[0.04, 0.01], [0.01, 0.09]]]),
    heading_sd_rad=math.radians(3),
    velocity_sd_m_s=0.5,
)
SENT = SentMessages(
    clock_offset_s=0.002,
    messages=(
        Message(
            kind=MessageKind.CPM,
            size_bytes=400,
            timestamp_s=6.002,
            station=STATION,
            objects=OBJECTS,
            deliveries={
                "cav2": Delivery(delay_s=0.012, power_dbm=-61.5, path="nlosv"),
                "rsu1": Delivery(lost=LossReason.POWER, power_dbm=-90.25, path="nlos"),
            },
        ),
    ),
)


def test_what_has_a_side_is_mirrored_in_the_file() -> None:
    """Left becomes right: y, headings, turn rates, and the covariance of x and y."""
    document = build_messages_document(make_frame(index=3, time_s=6.0), SENT)
    (message,) = json.loads(format_json(document))["messages"]
    station, (item,) = message["station"], message["objects"]
    assert station["pose"] == pytest.approx([10, -20, 1, 0, -30, 0])
    assert station["yaw_rate_deg_s"] == pytest.approx(-4)
    assert station["heading_sd_deg"] == pytest.approx(0.5)
    assert item["centre_m"] == [30, -5, 0.75]
    assert item["heading_deg"] == pytest.approx(-90)
    assert item["velocity_m_s"] == [1, -9]
    assert item["covariance_m2"] == [0.04, -0.01, 0.09]
    assert message["deliveries"] == {
        "cav2": {"delay_s": 0.012, "power_dbm": -61.5, "path": "nlosv"},
        "rsu1": {"lost": "power", "power_dbm": -90.25, "path": "nlos"},
    }


def assert_same(one: Any, other: Any) -> None:
    """Compare records field by field, numbers but for rounding."""
    if hasattr(one, "__dataclass_fields__"):
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, np.ndarray) and one.dtype.kind == "f":
        np.testing.assert_allclose(one, other, atol=1e-6)
    elif isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    elif isinstance(one, float):
        assert one == pytest.approx(other, abs=1e-6)
    elif isinstance(one, dict):
        assert one.keys() == other.keys()
        for key, value in one.items():
            assert_same(value, other[key])
    elif isinstance(one, tuple):
        for mine, yours in zip(one, other, strict=True):
            assert_same(mine, yours)
    else:
        assert one == other


@pytest.mark.parametrize("layout", ["opv2v", "adver_city"])
def test_messages_are_read_as_they_were_sent(
    spec: Spec, sensor_frames_of: SensorFramesOf, tmp_path: Path, layout: str
) -> None:
    sending = spec.model_copy(update={"channel": Channel(id="tested")})
    written = write_scenario(
        tmp_path,
        sending,
        lambda index: tuple(
            replace(item, sent=SENT if item.agent.is_ego else SentMessages(0.0))
            for item in sensor_frames_of(index)
        ),
        format=layout,
    )
    frame = Scenario(written)[0]
    assert_same(load_sent_messages(frame["cav1"]), SENT)
    assert load_sent_messages(frame["rsu1"]).messages == ()
