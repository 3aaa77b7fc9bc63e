"""Directions of beams, and beams towards a box."""

from itertools import product

import numpy as np
import pytest
from advercity_dsl import Lidar
from pydantic import ValidationError

from advercity.geometry.poses import pose_matrix
from advercity.sensors.lidar import (
    beam_directions,
    channel_elevations_rad,
)
from advercity.sensors.lidar.beams import BeamGrid
from tests.sensors.lidar.builders import DARK, vary


def test_channels_and_azimuths_are_the_original_ones() -> None:
    channels = np.degrees(channel_elevations_rad(Lidar()))
    assert len(channels) == 32
    assert (channels[0], channels[-1]) == (pytest.approx(-25), pytest.approx(15))
    np.testing.assert_allclose(np.diff(channels), 1.290323, atol=1e-6)
    directions = beam_directions(Lidar()).reshape(3750, 32, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    azimuth = np.degrees(np.arctan2(directions[:3, 7, 1], directions[:3, 7, 0]))
    np.testing.assert_allclose(azimuth, [0, 0.096, 0.192], atol=1e-5)


def test_a_raised_roadside_lidar_looks_down() -> None:
    channels = np.degrees(channel_elevations_rad(Lidar(upper_deg=-1)))
    np.testing.assert_allclose(np.diff(channels), 24 / 31)


@pytest.mark.parametrize(
    ("table", "lowest", "highest"), [("hdl_32e", -30.67, 10.67), ("vlp_32c", -25.0, 15.0)]
)
def test_real_sensors_have_their_own_channels(table: str, lowest: float, highest: float) -> None:
    lidar = vary(Lidar(), channel_table=table)
    channels = np.degrees(channel_elevations_rad(lidar))
    assert len(channels) == 32
    assert (np.diff(channels) > 0).all()
    assert (channels[0], channels[-1]) == (pytest.approx(lowest), pytest.approx(highest))
    elevation = np.arcsin(beam_directions(lidar).reshape(3750, 32, 3)[5, :, 2])
    np.testing.assert_allclose(elevation, channel_elevations_rad(lidar), atol=1e-6)


def test_some_channels_of_a_vlp_32c_have_azimuth_offsets() -> None:
    directions = beam_directions(vary(Lidar(), channel_table="vlp_32c")).reshape(3750, 32, 3)[0]
    aside = np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))
    np.testing.assert_allclose(np.unique(np.abs(aside).round(3)), [1.4, 4.2])
    assert aside[0] == pytest.approx(-1.4, abs=1e-4)


def test_a_real_sensor_with_other_channels_is_refused() -> None:
    with pytest.raises(ValidationError, match="hdl_32e has 32 channels, not 64"):
        vary(Lidar(), channel_table="hdl_32e", channels=64)


@pytest.mark.parametrize("middle", [(9, 2, 1), (-15, 0.1, 0), (0.5, 12, 3), (12, -9, 4), (0, 1, 0)])
def test_a_grid_finds_every_beam_that_hits_a_box(middle: tuple[float, float, float]) -> None:
    lidar = vary(DARK, channel_table="vlp_32c", azimuths=720)
    stand = pose_matrix((1, 2, 0.5), yaw=2.0, pitch=0.08, roll=-0.05)
    low, high = np.subtract(middle, (2, 1, 1)), np.add(middle, (2, 1, 1))
    corners = np.array([[x, y, z] for x, y, z in product(*zip(low, high, strict=True))])
    slope = 1.0 / (beam_directions(lidar) @ stand[:3, :3].T)
    one, other = (low - stand[:3, 3]) * slope, (high - stand[:3, 3]) * slope
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    meets = np.flatnonzero(leave > np.maximum(enter, 0.0))
    found = BeamGrid.from_lidar(lidar, stand).find_beams_towards(corners)
    assert len(meets) > 20
    assert set(meets) <= set(found)
