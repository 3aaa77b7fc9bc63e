"""MCAP: a recording of every scenario, with the schemas of Foxglove or the messages of ROS 2.

    <scenario>.mcap

Frames: `world` is x east, y north, z up; `<agent>` is x forward, y left, z up, on the ground under
a vehicle; `<agent>/lidar0` and `<agent>/radar0` have such axes, too; `<agent>/camera0` is optical:
x right, y down, z along the view. Times count from the start of the scenario.
"""

from collections.abc import Iterator, Mapping

from advercity.dataset.agent_view import AgentView
from advercity.dataset.formats import OPV2V
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.dataset.weather_truth import WeatherTruth
from advercity.errors import InputError
from advercity.exports.pieces import Piece, PieceFiles, read_image_file, split_by_scenario
from advercity.exports.registry import Options
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity_exports.mcap_foxglove import FoxgloveEncoder
from advercity_exports.mcap_ros2 import Ros2Encoder
from advercity_exports.mcap_values import PositionCovariance, Stamp

WORLD = "world"
Encoder = FoxgloveEncoder | Ros2Encoder
ENCODERS: Mapping[str, type[Encoder]] = {"foxglove": FoxgloveEncoder, "ros2": Ros2Encoder}


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every scenario; InputError if a library or a layout does not fit."""
    encoder = ENCODERS[options["schemas"]]
    encoder.load_libraries()
    for scenario in dataset.scenarios:
        if scenario.format != OPV2V:
            raise InputError(
                f"{scenario.path}: has the layout {scenario.format.name}; mcap is exported from"
                f" {OPV2V.name}"
            )
    return split_by_scenario(
        dataset, lambda scenario, files: _write_scenario(scenario, files, encoder)
    )


def _write_scenario(scenario: Scenario, files: PieceFiles, encoder: type[Encoder]) -> None:
    with files.open(f"{scenario.path.name}.mcap") as stream:
        recording = encoder(stream)
        shown: dict[str, int] = {}
        for frame in files.track(scenario):
            _write_frame(frame, recording, shown)
        recording.finish()


def _write_frame(frame: FrameView, recording: Encoder, shown: dict[str, int]) -> None:
    """Write a frame; `shown` has the times of the last samples of sensors, which are noted."""
    time_ns = round(frame.time_s * 1e9)
    spec = frame.scenario.spec
    weather = WeatherTruth.from_weather(spec.weather.at(frame.index * spec.timing.tick_s))
    recording.write_weather("/weather", Stamp(time_ns, WORLD), weather.model_dump(mode="json"))
    poses = [pose for view in frame.views.values() for pose in _list_poses(view)]
    stamps = {name: ns for view in frame.views.values() for name, ns in _list_stamps(view)}
    with_frame = [pose for pose in poses if pose[0] not in stamps]
    recording.write_transforms("/tf", Stamp(time_ns, WORLD), with_frame)
    repeated = {name for name, stamp_ns in stamps.items() if shown.get(name) == stamp_ns}
    shown |= stamps
    for pose in poses:
        if pose[0] in stamps.keys() - repeated:
            recording.write_transforms("/tf", Stamp(stamps[pose[0]], WORLD), [pose])

    def list_new(view: AgentView, kind: str, count: int) -> Iterator[tuple[int, str, Stamp]]:
        """List number, topic and stamp of the sensors of a kind with a new measurement."""
        for number in range(count):
            name = f"{view.agent.id}/{kind}{number}"
            if name not in repeated:
                yield number, f"/{name}", Stamp(stamps.get(name, time_ns), name)

    for name, view in frame.views.items():
        recording.write_objects(f"/{name}/objects", Stamp(time_ns, WORLD), view.load_steady_boxes())
        for number, sensor, stamp in list_new(view, "camera", view.cameras):
            image = read_image_file(view.path(f"_camera{number}.png"))
            recording.write_image(f"{sensor}/image", stamp, image)
            recording.write_calibration(f"{sensor}/calibration", stamp, view, number)
        for number, sensor, stamp in list_new(view, "lidar", view.lidars):
            recording.write_points(f"{sensor}/points", stamp, view.load_cloud(number))
        for number, sensor, stamp in list_new(view, "radar", view.radars):
            recording.write_points(f"{sensor}/detections", stamp, view.load_radar(number))
        for number, sensor, stamp in list_new(view, "thermal", view.thermals):
            path = view.path(f"_thermal{number}.png")
            recording.write_image(f"{sensor}/image", stamp, read_image_file(path))
        gnss, imu = view.motion
        if gnss is not None:
            covariance = PositionCovariance.of_fix(view.agent.sensors.gnss, gnss)
            recording.write_fix(f"/{name}/gnss", Stamp(time_ns, name), gnss, covariance)
        if imu is not None:
            recording.write_imu(f"/{name}/imu", Stamp(time_ns, name), imu)


def _list_stamps(view: AgentView) -> Iterator[tuple[str, int]]:
    """List the sensors with rates of their own, by the names of their frames, and their times."""
    for sensor, time_s in view.stamps.items():
        yield f"{view.agent.id}/{sensor}", round(time_s * 1e9)


def _list_poses(view: AgentView) -> Iterator[tuple[str, Matrix]]:
    """List the frames of an agent and its sensors, and their poses (4, 4) in the world."""
    name = view.agent.id
    yield name, view.world_from_agent
    for number in range(view.cameras):
        yield f"{name}/camera{number}", view.world_from_camera(number) @ poses.OPTICAL_FROM_BODY.T
    for number in range(view.thermals):
        yield f"{name}/thermal{number}", view.load_thermal_pose(number) @ poses.OPTICAL_FROM_BODY.T
    for number in range(view.lidars):
        yield f"{name}/lidar{number}", view.load_lidar_pose(number)
    for number in range(view.radars):
        yield f"{name}/radar{number}", view.load_radar_pose(number)
