"""The fact tables of V2X messages: the fate of each, and the age of the newest."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.reader import FrameView
from advercity.dataset.received_messages import load_sent_messages
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.sensors.messages import to_level_pose

MESSAGE_FACT = np.dtype(
    [
        ("frame", "<i4"),
        ("kind", "<U4"),
        ("distance_m", "<f8"),
        ("path", "<U5"),
        ("lost", "<U8"),
        ("delay_s", "<f8"),
        ("position_error_m", "<f8"),
        ("heading_error_rad", "<f8"),
    ]
)
"""A message at one receiver: its kind, the distance of the two agents, the obstacles between them
(empty without a radio), why it was lost (empty if it arrives), its delay (NaN if it was lost), and
the errors of its pose, horizontally and of the heading."""
AGE_FACT = np.dtype([("frame", "<i4"), ("kind", "<U4"), ("age_s", "<f8")])
"""The ego's newest message of a kind and a sender in a frame."""

NO_MESSAGES, NO_AGES = np.empty(0, MESSAGE_FACT), np.empty(0, AGE_FACT)


def collect_message_facts(frame: FrameView) -> NDArray[np.void]:
    """Collect the messages sent in a frame, (n,) of `MESSAGE_FACT`, if there is a channel."""
    if frame.scenario.channel is None:
        return NO_MESSAGES
    truth = {name: view.world_from_agent for name, view in frame.views.items()}
    facts: list[tuple[Any, ...]] = []
    for name, view in frame.views.items():
        for message in load_sent_messages(view).messages:
            errors = _measure_errors(message.station.world_from_station, truth[name])
            for receiver, delivery in message.deliveries.items():
                distance_m = math.dist(truth[name][:3, 3], truth[receiver][:3, 3])
                delay_s = math.nan if delivery.delay_s is None else delivery.delay_s
                fate = (delivery.path or "", delivery.lost or "", delay_s)
                facts.append((frame.index, message.kind.value, distance_m, *fate, *errors))
    return np.array(facts, MESSAGE_FACT)


def collect_age_facts(frame: FrameView) -> NDArray[np.void]:
    """Collect the ego's messages in a frame, (n,) of `AGE_FACT`, if there is a channel."""
    if frame.scenario.channel is None:
        return NO_AGES
    own = frame.messages(frame.scenario.ego)
    facts = [(frame.index, item.kind.value, item.age_s) for item in own]
    return np.array(facts, AGE_FACT)


def _measure_errors(sent: Matrix, true: Matrix) -> tuple[float, float]:
    """Measure the horizontal distance and the angle between a transmitted and the true pose."""
    turn_rad, _, _ = poses.to_yaw_pitch_roll(poses.invert_pose(to_level_pose(true)) @ sent)
    return math.dist(sent[:2, 3], true[:2, 3]), turn_rad
