"""Datasets to export."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Mount, Radar, Spec

from advercity.compiler import with_digest
from advercity.sensors.measurements import RadarDetections
from advercity.sensors.sensor_frame import RadarScan, SensorFrame
from tests.builders import (
    SensorFramesOf,
    ask_for_instances,
    frame_of,
    mounted_at,
    sensor_frame_of,
    write_scenario,
)

RADAR_MOUNT = Mount(x_m=2.0, z_m=0.5)
SEEN_BY_RADAR = ((20.0, 15.0, 0.0), (30.0, -4.0, 1.0))
"""Detections in the radar's frame: at rest over the ground, and on vehicle 201."""


def with_radar_scan(sensor_frame: SensorFrame) -> SensorFrame:
    """Let the ego's radar report two detections, and those of the others none."""
    if not sensor_frame.agent.sensors.radars:
        return sensor_frame
    points = np.array(SEEN_BY_RADAR, np.float32)[: 2 * sensor_frame.agent.is_ego]
    ahead = points[:, 0] / np.maximum(np.linalg.norm(points, axis=1), 1.0)
    scan = RadarScan(
        sensor_frame.world_from_agent @ mounted_at(RADAR_MOUNT),
        RadarDetections(
            points=points,
            velocity_m_s=(-sensor_frame.speed_m_s * ahead).astype(np.float32),
            rcs_dbsm=np.full(len(points), 12.0, np.float32),
            snr_db=np.full(len(points), 25.0, np.float32),
            instance=np.array([0, 201], np.int32)[: len(points)],
            kind=np.zeros(len(points), np.uint8),
        ),
    )
    return sensor_frame.with_readings(radar=(scan,))


@pytest.fixture(scope="session")
def masked_dataset(tmp_path_factory: pytest.TempPathFactory, spec: Spec) -> Path:
    """Two frames of agents whose cameras have images of actors' ids."""
    asking = ask_for_instances(spec)

    def sensor_frames(index: int) -> tuple[SensorFrame, ...]:
        return tuple(sensor_frame_of(agent, frame_of(asking, index)) for agent in asking.agents)

    root = tmp_path_factory.mktemp("masks")
    write_scenario(root, asking, sensor_frames, frames=2)
    return root


def write_radar_scenario(
    root: Path, spec: Spec, sensor_frames_of: SensorFramesOf, *, kinds: tuple[str, ...]
) -> Path:
    """Write two frames of agents of which those of some kinds have a radar ahead."""
    radar = Radar(mounts=(RADAR_MOUNT,))
    agents = tuple(
        agent.model_copy(
            update={
                "sensors": agent.sensors.model_copy(
                    update={"radar": radar if agent.place.kind in kinds else None}
                )
            }
        )
        for agent in spec.agents
    )
    equipped = with_digest(spec.model_copy(update={"agents": agents}))

    def sensor_frames(index: int) -> tuple[SensorFrame, ...]:
        return tuple(
            with_radar_scan(replace(frame, agent=agent))
            for frame, agent in zip(sensor_frames_of(index), agents, strict=True)
        )

    write_scenario(root, equipped, sensor_frames, frames=2)
    return root


@pytest.fixture(scope="session")
def radar_dataset(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    """Two frames of agents of which the connected vehicles have a radar ahead."""
    root = tmp_path_factory.mktemp("radars")
    return write_radar_scenario(root, spec, sensor_frames_of, kinds=("vehicle",))


@pytest.fixture(scope="session")
def all_radars_dataset(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    """The same with a radar on roadside units, too."""
    root = tmp_path_factory.mktemp("all_radars")
    kinds = ("vehicle", "roadside_unit")
    return write_radar_scenario(root, spec, sensor_frames_of, kinds=kinds)
