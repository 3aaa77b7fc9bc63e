"""Radars in a dataset: their detections, cubes and poses."""

from functools import partial
from typing import Any

from advercity_dsl import Agent

from advercity.dataset import radar_codec
from advercity.dataset.agent_view import AgentView
from advercity.dataset.carla_frame import carla_pose_from_matrix
from advercity.dataset.formats import DatasetFormat
from advercity.dataset.plain_documents import to_plain
from advercity.dataset.sensor_files import EncodingJobs, FileOptions, SensorFiles
from advercity.sensors.sensor_frame import RadarScan, SensorFrame


def _has_cube(agent: Agent, number: int) -> bool:
    return agent.sensors.radars[number].model.output == "cube"


def _list_suffixes(agent: Agent, number: int, layout: DatasetFormat) -> tuple[str, ...]:
    cube = (layout.format_cube_suffix(number),) if _has_cube(agent, number) else ()
    return (layout.format_radar_suffix(number), *cube)


def _encode(item: SensorFrame, number: int, options: FileOptions) -> EncodingJobs:
    scan, layout = item.radar_scans[number], options.layout
    detections = partial(radar_codec.encode_detections, scan.detections, options.clouds)
    jobs = {layout.format_radar_suffix(number): detections}
    if scan.cube is not None:
        jobs[layout.format_cube_suffix(number)] = partial(radar_codec.encode_cube, scan.cube)
    return jobs


def _describe(item: SensorFrame, number: int) -> dict[str, Any]:
    pose = item.radar_scans[number].world_from_radar
    return {f"radar{number}_pose": to_plain(carla_pose_from_matrix(pose))}


def _read(view: AgentView, number: int) -> RadarScan:
    return RadarScan(
        view.load_radar_pose(number),
        radar_codec.parse_detections(view.load_radar(number)),
        view.load_radar_cube(number) if _has_cube(view.agent, number) else None,
        view.stamps.get(f"radar{number}"),
    )


FILES = SensorFiles(
    read=_read,
    list_suffixes=_list_suffixes,
    encode=_encode,
    describe=_describe,
    locate=AgentView.load_radar_pose,
)
