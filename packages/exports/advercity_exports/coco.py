"""COCO: boxes and instance masks of the objects in every image, and panoptic images.

    images/<scenario>/<agent>/000060_camera0.png          the images as they are
    panoptic/<scenario>/<agent>/000060_camera0.png        ids of segments: R + 256 G + 256² B
    annotations/instances.json                            boxes and masks
    annotations/panoptic.json                             categories of the segments

Boxes enclose the visible pixels. As in COCO, a rider is a person of its own, and the box of a
two-wheeler holds the machine alone. Such boxes, masks and panoptic images need images of actors'
ids, which a rig asks for with `truth: [instance]`; without them there are boxes alone, around both.
A tractor unit and its semi-trailer are one truck, as in COCO and Cityscapes.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.image_codec import encode_label_png, to_instance_colours
from advercity.dataset.reader import Dataset, FrameView, Scenario
from advercity.exports.pieces import (
    JsonList,
    Piece,
    PieceFiles,
    make_common_piece,
    split_by_frame,
)
from advercity.exports.registry import Options
from advercity.semantics import PALETTE, Semantic
from advercity_exports.libraries import load_library
from advercity_exports.requirements import require_truth

_logger = logging.getLogger(__name__)

CATEGORIES = {
    "pedestrian": (1, "person", "person"),
    "bicycle": (2, "bicycle", "vehicle"),
    "car": (3, "car", "vehicle"),
    "van": (3, "car", "vehicle"),
    "motorcycle": (4, "motorcycle", "vehicle"),
    "truck": (8, "truck", "vehicle"),
}
"""COCO's id, name and group by class, for detectors trained on COCO. COCO has no vans."""
RIDDEN_CLASSES = frozenset({"bicycle", "motorcycle"})
FIRST_STUFF_CATEGORY = 200
"""Category of semantic tag 0 in panoptic images; COCO's own end below."""
FIRST_STUFF_SEGMENT = 1 << 23
"""Segment of semantic tag 0; ids of actors are below."""
FIRST_RIDER_SEGMENT = 3 << 22
"""Segment of the rider of actor 0."""
LEAST_FRACTION = 5e-5
"""Below it, a dataset's fractions of four decimals are 0."""
Json = dict[str, Any]


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every frame's images, and one of each file of annotations.

    Raises:
        InputError: A scenario has the original's layout, or pycocotools is not installed.
    """
    require_truth(dataset, "coco")
    cameras = _list_cameras(dataset)
    if any(cameras.values()):
        load_library("pycocotools.mask", "coco")
    if not all(cameras.values()):
        _logger.warning(
            "%d of %d cameras have no images of actors' ids, and so no masks: boxes are exported;"
            " ask for them with `truth: [instance]` in the rig",
            sum(not has_masks for has_masks in cameras.values()),
            len(cameras),
        )
    pieces = [
        *split_by_frame(dataset, _write_images),
        make_common_piece(dataset, "instances", lambda files: _write_instances(dataset, files)),
    ]
    if any(cameras.values()):
        pieces.append(
            make_common_piece(dataset, "panoptic", lambda files: _write_panoptic(dataset, files))
        )
    return pieces


def _list_cameras(dataset: Dataset) -> dict[tuple[str, str, int], bool]:
    """List cameras by scenario, agent and number, and whether they have images of ids."""
    return {
        (scenario.path.name, agent.id, number): "instance" in mounted.model.truth
        for scenario in dataset.scenarios
        for agent in scenario.spec.recorded_agents
        for number, mounted in enumerate(agent.sensors.cameras)
    }


@dataclass(frozen=True)
class Shot:
    """An image.

    Attributes:
        id: Number of the image, from 1.
        frame: The frame.
        view: The data of the agent.
        camera: Number of the camera.
    """

    id: int
    frame: FrameView
    view: AgentView
    camera: int

    @property
    def path(self) -> str:
        """Path of the image below `images/`, and of its segments below `panoptic/`."""
        name = f"{self.frame.name}_camera{self.camera}.png"
        return f"{self.frame.scenario.path.name}/{self.view.agent.id}/{name}"

    @property
    def has_masks(self) -> bool:
        """Whether there is an image of actors' ids."""
        return self.view.has_truth("instance", self.camera)


def _list_shots(frame: FrameView, first: int) -> list[Shot]:
    """List the images of a frame, numbered from `first` on."""
    places = [(view, n) for view in frame.views.values() for n in range(view.cameras)]
    return [Shot(first + k, frame, view, camera) for k, (view, camera) in enumerate(places)]


def _write_images(frame: FrameView, number: int, files: PieceFiles) -> None:
    for shot in _list_shots(frame, 0):
        files.copy(shot.view.path(f"_camera{shot.camera}.png"), f"images/{shot.path}")
        if shot.has_masks:
            segments = to_instance_colours(_read_segments(shot))
            files.write(f"panoptic/{shot.path}", encode_label_png(segments))


def _read_segments(shot: Shot) -> NDArray[np.int32]:
    """Read the segments (h, w): actors, their riders, and all else by class; 0 is unlabelled."""
    instance = _read_instance(shot)
    tags = shot.view.semantic(shot.camera).astype(np.int32)
    stuff = np.where(tags > 0, tags + FIRST_STUFF_SEGMENT, 0)
    ridden = [
        number
        for number, (one, *_) in _group_objects(shot).items()
        if one["class"] in RIDDEN_CLASSES
    ]
    is_rider = np.isin(instance, ridden) & (tags == Semantic.PEDESTRIAN)
    actors = instance + FIRST_RIDER_SEGMENT * is_rider
    return np.where(instance > 0, actors, stuff).astype(np.int32)


def _read_instance(shot: Shot) -> NDArray[np.int32]:
    """Read the ids (h, w) of actors, with the tractor unit's id for its semi-trailer."""
    instance = shot.view.instance(shot.camera).copy()
    for name, described in shot.view.extras["objects"].items():
        if "towed_by" in described:
            instance[instance == int(name)] = described["towed_by"]
    return instance


def _group_objects(shot: Shot) -> dict[int, list[Json]]:
    """Group the objects of a view by id, a semi-trailer with its tractor unit."""
    groups: dict[int, list[Json]] = {}
    for name, described in shot.view.extras["objects"].items():
        groups.setdefault(described.get("towed_by", int(name)), []).append(described)
    return groups


def _iterate_shots(dataset: Dataset, files: PieceFiles) -> Iterator[Shot]:
    """Iterate over all images, in the order of their numbers."""
    number = 1
    for scenario in dataset.scenarios:
        for frame in files.track(scenario):
            shots = _list_shots(frame, number)
            yield from shots
            number += len(shots)


def _write_instances(dataset: Dataset, files: PieceFiles) -> None:

    def list_rows() -> Iterator[Json]:
        number = 1
        for shot in _iterate_shots(dataset, files):
            for row in _describe_objects(shot):
                yield {"id": number, **row}
                number += 1

    _write_document(dataset, files, "annotations/instances.json", _list_things(), list_rows())


def _write_panoptic(dataset: Dataset, files: PieceFiles) -> None:
    things = [{**thing, "isthing": 1} for thing in _list_things()]
    stuff: list[Json] = [
        {
            "id": FIRST_STUFF_CATEGORY + tag,
            "name": tag.name.lower(),
            "supercategory": "stuff",
            "isthing": 0,
            "color": PALETTE[tag].tolist(),
        }
        for tag in Semantic
        if tag != Semantic.UNLABELED
    ]
    rows = (
        {
            "image_id": shot.id,
            "file_name": shot.path,
            "segments_info": list(_describe_segments(shot)),
        }
        for shot in _iterate_shots(dataset, files)
        if shot.has_masks
    )
    _write_document(dataset, files, "annotations/panoptic.json", [*things, *stuff], rows)


def _list_things() -> list[Json]:
    things = {number: (name, group) for number, name, group in CATEGORIES.values()}
    return [
        {"id": number, "name": name, "supercategory": group}
        for number, (name, group) in sorted(things.items())
    ]


def _write_document(
    dataset: Dataset,
    files: PieceFiles,
    path: str,
    categories: Sequence[Json],
    annotations: Iterable[Json],
) -> None:
    """Write a file of annotations row by row: it may be larger than memory."""
    names = ", ".join(one.path.name for one in dataset.scenarios[:3])
    more = f" and {len(dataset.scenarios) - 3} more" if len(dataset.scenarios) > 3 else ""
    head = {
        "info": {"description": f"advercity: {names}{more}", "version": "1.0"},
        "licenses": [],
        "categories": categories,
    }
    with files.open(path) as stream:
        stream.write(json.dumps(head).encode()[:-1])
        for field, rows in (("images", _iterate_image_rows(dataset)), ("annotations", annotations)):
            stream.write(f',\n"{field}": '.encode())
            with JsonList(stream) as written:
                for row in rows:
                    written.append(row)
        stream.write(b"}\n")


def _iterate_image_rows(dataset: Dataset) -> Iterator[Json]:
    """Describe all images; sizes are read once per scenario, since they stay."""
    number = 1
    for scenario in dataset.scenarios:
        sizes = _measure_images(scenario)
        for frame in scenario:
            for shot in _list_shots(frame, number):
                width, height = sizes[shot.view.agent.id, shot.camera]
                time_s = shot.view.stamps.get(f"camera{shot.camera}", frame.time_s)
                yield {
                    "id": shot.id,
                    "file_name": shot.path,
                    "width": width,
                    "height": height,
                    "scenario": scenario.path.name,
                    "agent": shot.view.agent.id,
                    "camera": shot.camera,
                    "frame": frame.index,
                    "time_s": round(time_s, 6),
                }
                number += 1


def _measure_images(scenario: Scenario) -> dict[tuple[str, int], tuple[int, int]]:
    """Measure width and height of the images of each camera."""
    found: dict[tuple[str, int], tuple[int, int]] = {}
    for shot in _list_shots(scenario[0], 0) if len(scenario) else ():
        model = shot.view.camera_model(shot.camera)
        found[shot.view.agent.id, shot.camera] = model.width_px, model.height_px
    return found


def _describe_objects(shot: Shot) -> Iterator[Json]:
    """Describe the visible parts of objects: box, area and mask; mark crowds.

    Actors not annotated by the agent, since no beam of its LiDARs hits them, are crowds:
    evaluations count neither finding nor missing them as an error.
    """
    segments = _read_segments(shot) if shot.has_masks else None
    annotated: set[int] = set()
    for number, group in _group_objects(shot).items():
        cameras = [one["cameras"].get(f"camera{shot.camera}") for one in group]
        seen = [one for one in cameras if one is not None and one["visible_box"] is not None]
        if not seen:
            continue
        annotated.add(number)
        shown = _join_views(seen)
        for kind, outline in _outline_parts(number, group[0]["class"], shown, segments):
            yield {
                "image_id": shot.id,
                "category_id": CATEGORIES["pedestrian" if kind == "rider" else kind][0],
                **outline,
                "iscrowd": 0,
                "object_id": number,
                "class": kind,
                **{key: shown[key] for key in ("visible_fraction", "occlusion", "truncation")},
            }
    if segments is not None:
        yield from _describe_crowds(shot, annotated)


def _join_views(seen: Sequence[Json]) -> Json:
    """Join the views of one object, or of a tractor unit and its semi-trailer.

    Their outlines add up: they overlap little, and a completely hidden one is left out.
    """
    if len(seen) == 1:
        return seen[0]
    boxes = np.array([one["visible_box"] for one in seen])
    visible_px = sum(one["visible_px"] for one in seen)
    outlines_px = [one["visible_px"] / max(one["visible_fraction"], LEAST_FRACTION) for one in seen]
    inside_px = sum(
        px * (1.0 - one["truncation"]) for px, one in zip(outlines_px, seen, strict=True)
    )
    fractions = {
        "visible_fraction": visible_px / sum(outlines_px),
        "occlusion": 1.0 - visible_px / inside_px,
        "truncation": 1.0 - inside_px / sum(outlines_px),
    }
    return {
        "visible_px": visible_px,
        "visible_box": [*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist()],
        **{name: round(float(np.clip(part, 0.0, 1.0)), 4) for name, part in fractions.items()},
    }


def _outline_parts(
    number: int, actor_class: str, shown: Json, segments: NDArray[np.int32] | None
) -> Iterator[tuple[str, Json]]:
    """Outline the visible part of an object, and of its rider: box, area, mask by class."""
    if segments is None:
        left, top, right, bottom = shown["visible_box"]
        box = [left, top, right - left, bottom - top]
        yield actor_class, {"bbox": box, "area": shown["visible_px"], "segmentation": []}
        return
    parts = {actor_class: number}
    if actor_class in RIDDEN_CLASSES:
        parts["rider"] = FIRST_RIDER_SEGMENT + number
    for kind, segment in parts.items():
        mask = segments == segment
        if mask.any():
            yield kind, _outline_mask(mask)


def _outline_mask(mask: NDArray[np.bool_]) -> Json:
    """Outline a mask (h, w) with at least a pixel: its box, area and run lengths."""
    return {
        "bbox": measure_box(mask),
        "area": int(mask.sum()),
        "segmentation": _encode_mask(mask),
    }


def _describe_crowds(shot: Shot, annotated: set[int]) -> Iterator[Json]:
    instance, tags = _read_instance(shot), shot.view.semantic(shot.camera)
    for number in np.unique(instance).tolist():
        if number == 0 or number in annotated:
            continue
        mask = instance == number
        yield {
            "image_id": shot.id,
            "category_id": _guess_category(tags[mask]),
            **_outline_mask(mask),
            "iscrowd": 1,
            "object_id": number,
        }


def _guess_category(tags: NDArray[np.uint8]) -> int:
    """Guess the category of an actor from the tags (n,) of its pixels."""
    on_foot = np.bincount(tags).argmax() == Semantic.PEDESTRIAN
    return CATEGORIES["pedestrian" if on_foot else "car"][0]


def measure_box(mask: NDArray[np.bool_]) -> list[float]:
    """Measure left, top, width and height of a mask (h, w) with at least a pixel."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    left, top = float(columns[0]), float(rows[0])
    return [left, top, float(columns[-1] + 1 - left), float(rows[-1] + 1 - top)]


def _encode_mask(mask: NDArray[np.bool_]) -> Json:
    """Encode a mask (h, w) as COCO's run lengths."""
    coder = load_library("pycocotools.mask", "coco")
    encoded = coder.encode(np.asfortranarray(mask.astype(np.uint8)))
    return {"size": list(encoded["size"]), "counts": encoded["counts"].decode("ascii")}


def _describe_segments(shot: Shot) -> Iterator[Json]:
    segments = _read_segments(shot)
    tags, groups = shot.view.semantic(shot.camera), _group_objects(shot)
    for number in np.unique(segments).tolist():
        if number == 0:
            continue
        mask = segments == number
        group = groups.get(number)
        if number >= FIRST_RIDER_SEGMENT:
            category = CATEGORIES["pedestrian"][0]
        elif number >= FIRST_STUFF_SEGMENT:
            category = FIRST_STUFF_CATEGORY + number - FIRST_STUFF_SEGMENT
        elif group is not None:
            category = CATEGORIES[group[0]["class"]][0]
        else:
            category = _guess_category(tags[mask])
        yield {
            "id": number,
            "category_id": category,
            "area": int(mask.sum()),
            "bbox": measure_box(mask),
            "iscrowd": int(number < FIRST_STUFF_SEGMENT and group is None),
        }
