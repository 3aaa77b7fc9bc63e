"""The files of a frame in both layouts, as bytes by their paths.

OPV2V: files in the form expected by OpenCOOD, HEAL, CoAlign and CoBEVT, and extras which these
loaders ignore: semantic images, more of every object, GNSS and IMU.

Adver-City: the names and files of the original, for the original's tools. Loaders of
OPV2V do not read it: they miss the `.pcd`, take `_gnss_imu.yaml` for a frame and the second
roadside unit for the ego.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol

from advercity.dataset.bird_view import draw_bird_views
from advercity.dataset.formats import ADVER_CITY, OPV2V, DatasetFormat
from advercity.dataset.frame_documents import (
    build_frame_description,
    build_motion_document,
    build_object_extras,
)
from advercity.dataset.image_codec import encode_label_png, to_three_channels
from advercity.dataset.message_documents import build_messages_document
from advercity.dataset.plain_documents import format_json, format_yaml
from advercity.dataset.sensor_files import FileOptions, iterate_readings
from advercity.geometry.arrays import Uint8Array
from advercity.roads.lane_segments import LaneSegment
from advercity.run_options import CloudEncoding
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.sensor_frame import SensorFrame


class FrameEncoder(Protocol):
    """Encodes every file of one frame, by path within the scenario."""

    def __call__(
        self, sensor_frames: Sequence[SensorFrame], lanes: Sequence[LaneSegment], *, name: str
    ) -> dict[str, bytes]:
        """Encode the files of the frame called `name`."""
        ...


def encode_opv2v_frame(
    sensor_frames: Sequence[SensorFrame],
    lanes: Sequence[LaneSegment],
    *,
    name: str,
    clouds: CloudEncoding = "binary_compressed",
) -> dict[str, bytes]:
    """Encode every file of one frame, by path within the scenario.

    Args:
        sensor_frames: One per agent; loaders fail where an agent is left out.
        lanes: Lanes of the road, for the maps.
        name: Name of the frame.
        clouds: Encoding of point clouds.
    """
    # Descriptions come last and the ego's is the very last: loaders take a frame for existing when
    # they find it, and files are moved into place in this order.
    ordered = sorted(sensor_frames, key=lambda item: OPV2V.format_folder(item.agent), reverse=True)
    stems = [_format_stem(OPV2V, item, name) for item in ordered]
    options = FileOptions(OPV2V, clouds)
    jobs: dict[str, Callable[[], bytes]] = {}
    for stem, item in zip(stems, ordered, strict=True):
        jobs |= _list_sensor_jobs(stem, item, options)
    for stem, maps in zip(stems, draw_bird_views(ordered, lanes), strict=True):
        jobs |= {
            f"{stem}_bev_{kind}.png": partial(_encode_mask, mask) for kind, mask in maps.items()
        }
    files = _run_concurrently(jobs)
    annotations = [annotate_actors(item) for item in ordered]
    for stem, item, annotated in zip(stems, ordered, annotations, strict=True):
        files[f"{stem}_objects.json"] = format_json(build_object_extras(item, annotated))
    for stem, item, annotated in zip(stems, ordered, annotations, strict=True):
        files[f"{stem}.yaml"] = format_yaml(build_frame_description(item, annotated))
    return files


def encode_adver_city_frame(
    sensor_frames: Sequence[SensorFrame], lanes: Sequence[LaneSegment], *, name: str
) -> dict[str, bytes]:
    """Encode every file of one frame, by path within the scenario.

    Args:
        sensor_frames: One per agent.
        lanes: Not used: this layout has no maps.
        name: Name of the frame.
    """
    jobs: dict[str, Callable[[], bytes]] = {}
    for item in sensor_frames:
        stem = _format_stem(ADVER_CITY, item, name)
        jobs |= _list_sensor_jobs(stem, item, FileOptions(ADVER_CITY, "binary_compressed"))
        jobs[f"{stem}.yaml"] = partial(_encode_description, item)
    return _run_concurrently(jobs)


def select_encoder(layout: str, clouds: CloudEncoding) -> FrameEncoder:
    """Select the encoder of a layout; `clouds` is for OPV2V's clouds, the original's are text."""
    if layout == ADVER_CITY.name:
        return encode_adver_city_frame
    return partial(encode_opv2v_frame, clouds=clouds)


def _list_sensor_jobs(
    stem: str, item: SensorFrame, options: FileOptions
) -> dict[str, Callable[[], bytes]]:
    """List encoders of the files of all sensors of an agent, and of its messages."""
    layout = options.layout
    listed = layout.list_suffixes(item.agent)
    jobs = {
        f"{stem}{suffix}": job
        for files, number in iterate_readings(item)
        for suffix, job in files.encode(item, number, options).items()
        if suffix in listed
    }
    if layout.motion_suffix in listed:
        jobs[f"{stem}{layout.motion_suffix}"] = partial(_encode_motion, item)
    if item.sent is not None:
        jobs[f"{stem}{layout.messages_suffix}"] = partial(_encode_messages, item)
    return jobs


def _run_concurrently(jobs: Mapping[str, Callable[[], bytes]]) -> dict[str, bytes]:
    """Run every job in a thread, and return the results by name in the order of the jobs."""
    # OpenCV, zlib-ng and NumPy release the interpreter lock.
    with ThreadPoolExecutor() as pool:
        running = {name: pool.submit(job) for name, job in jobs.items()}
    return {name: future.result() for name, future in running.items()}


def _format_stem(layout: DatasetFormat, item: SensorFrame, name: str) -> str:
    return f"{layout.format_folder(item.agent)}/{name}"


def _encode_mask(mask: Uint8Array) -> bytes:
    return encode_label_png(to_three_channels(mask))


def _encode_motion(item: SensorFrame) -> bytes:
    return format_yaml(build_motion_document(item))


def _encode_messages(item: SensorFrame) -> bytes:
    """Encode the messages of an agent, also an empty list, if there is a channel."""
    assert item.sent is not None
    return format_json(build_messages_document(item.frame, item.sent))


def _encode_description(item: SensorFrame) -> bytes:
    return format_yaml(build_frame_description(item, annotate_actors(item)))
