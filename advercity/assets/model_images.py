"""Images of foreign models: projects a model's textures onto its converted parts.

Conversion drops and merges triangles, so images are projected: a triangle of a converted part has
the image at the nearest triangle of the same material in the file.
"""

import hashlib
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.array_files import load_arrays
from advercity.assets.model_files import ModelPart
from advercity.errors import RunError
from advercity.geometry.arrays import Float32Array, Float64Array, Uint8Array
from advercity.material_maps import LINEAR_FROM_SRGB, MaterialMaps
from advercity.materials import ACTOR_PAINT, MATERIALS

IMAGES_VERSION = 2
"""Part of the name of stored images; raise it when projection changes."""
IMAGE_PX = 256
"""Side of each image of a model."""
MAX_IMAGES_BYTES = 2**28
_SAMPLES = np.array([(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4)]) / np.array([[3], [6], [6], [6]])
"""Barycentric coordinates of sample points for finding triangles."""
_CHUNK = 128
_FARTHEST = 2.0
"""How far texture coordinates extend beyond the nearest triangle, in sizes of it."""
MAX_WIDTH_M = 200.0
"""Wider images are a single point of their file, with no more information than the table."""
_NAME = re.compile(r"([0-9a-f]{64})/(\d+)")


@dataclass(frozen=True, eq=False)
class ModelImage:
    """The image of all parts of one material.

    Attributes:
        uv: By number of part, (m, 3, 2) float32 metres on the image, right and up, of each corner.
        maps: The image.
    """

    uv: Mapping[int, Float32Array]
    maps: MaterialMaps


def find_images_file(model: Path) -> Path:
    """Find where the images of a converted model are stored."""
    key = hashlib.sha256(f"{IMAGES_VERSION} {model.stem}".encode()).hexdigest()
    return model.with_name(f"{key}.npz")


def name_image(file: Path, number: int) -> str:
    """Name an image of a model, as `StoredImages` looks it up."""
    return f"{file.stem}/{number}"


class StoredImages(Mapping[str, MaterialMaps]):
    """The images of the converted models in a folder, by `name_image`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __getitem__(self, name: str) -> MaterialMaps:
        found = _NAME.fullmatch(name)
        if found is None:
            raise KeyError(name)
        return read_images(self._folder / f"{found[1]}.npz")[int(found[2])].maps

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and _NAME.fullmatch(name) is not None

    def __iter__(self) -> Iterator[str]:
        raise TypeError("images of models are looked up by name")

    def __len__(self) -> int:
        return 0


def pack_images(images: Sequence[ModelImage]) -> bytes:
    """Pack the images of a model."""
    arrays: dict[str, Any] = {"count": np.array(len(images))}
    for number, image in enumerate(images):
        arrays[f"color_{number}"] = image.maps.color
        arrays[f"scale_{number}"] = np.array([image.maps.tile_m, *(image.maps.mean or ())])
        arrays[f"parts_{number}"] = np.array(list(image.uv), dtype=np.int64)
        arrays |= {f"uv_{part}": uv for part, uv in image.uv.items()}
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def read_images(path: Path) -> list[ModelImage]:
    """Read the packed images of a model.

    Raises:
        RunError: The file is something else.
    """
    arrays = load_arrays(path, max_bytes=MAX_IMAGES_BYTES)
    try:
        return [_parse_image(arrays, number) for number in range(int(arrays["count"]))]
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(
            f"{path}: not images of a model: {error}; delete it, and it is made again"
        ) from error


def _parse_image(arrays: Mapping[str, NDArray[Any]], number: int) -> ModelImage:
    tile_m, red, green, blue = arrays[f"scale_{number}"].tolist()
    maps = MaterialMaps(arrays[f"color_{number}"], None, None, tile_m, (red, green, blue))
    uv = {part: arrays[f"uv_{part}"] for part in arrays[f"parts_{number}"].tolist()}
    return ModelImage(uv, maps)


def compute_images_digest(images: Iterable[ModelImage]) -> str:
    """Compute the SHA-256 of images' content; their placement is part of the bodies."""
    digest = hashlib.sha256()
    for image in images:
        maps = image.maps
        # Rounded like coordinates of worlds: all processors give the same digest.
        numbers = [round(value, 9) for value in (maps.tile_m, *(maps.mean or ()))]
        digest.update(f"{maps.color.shape} {maps.color.dtype} {numbers}\n".encode())
        digest.update(np.ascontiguousarray(maps.color).tobytes())
    return digest.hexdigest()


def project_images(
    converted: Sequence[ModelPart], sources: Sequence[ModelPart]
) -> list[ModelImage]:
    """Find the images of the materials of converted parts.

    `sources` are the file's parts in the body frame, with materials and wheels as converted.
    """
    images: list[ModelImage] = []
    for material in dict.fromkeys(part.material for part in converted):
        own = [source for source in sources if source.material == material]
        parts = {n: part for n, part in enumerate(converted) if part.material == material}
        atlas = list({id(s.image): s.image for s in own if s.image is not None}.values())
        is_pane = material in MATERIALS and MATERIALS[material].is_transparent
        if atlas and not is_pane:
            images += _project_image(parts, own, atlas)
    return images


@dataclass(frozen=True, eq=False)
class _Placement:
    """Images on the triangles of a part.

    Attributes:
        tile: (m,) number of the image, -1 for none.
        uv: (m, 3, 2) in [0, 1] of this image.
        area_m2: (m,).
    """

    tile: NDArray[np.int64]
    uv: Float64Array
    area_m2: Float64Array


def _project_image(
    parts: Mapping[int, ModelPart], sources: Sequence[ModelPart], atlas: Sequence[Uint8Array]
) -> Iterator[ModelImage]:
    placements = {
        number: _place(part, [s for s in sources if s.wheel == part.wheel], atlas)
        for number, part in parts.items()
    }
    joined = _Placement(
        np.concatenate([p.tile for p in placements.values()]),
        np.concatenate([p.uv for p in placements.values()]),
        np.concatenate([p.area_m2 for p in placements.values()]),
    )
    # A power of two; triangles without an image get an even tile of the mean.
    tiles = len(atlas) + bool((joined.tile < 0).any())
    count = 1 << (tiles - 1).bit_length()
    is_paint = next(iter(parts.values())).material == ACTOR_PAINT
    color = _draw_atlas(atlas, count, is_grey=is_paint)
    mean = _compute_mean(color, joined)
    color[:, IMAGE_PX * len(atlas) :] = _to_srgb(mean)
    tile_m = _compute_width(joined, count)
    if tile_m < MAX_WIDTH_M:
        uv = {
            n: (tile_m * _place_on_atlas(p, count)).astype(np.float32)
            for n, p in placements.items()
        }
        yield ModelImage(uv, MaterialMaps(color, None, None, tile_m, mean))


def _place(
    part: ModelPart, sources: Sequence[ModelPart], atlas: Sequence[Uint8Array]
) -> _Placement:
    targets = part.vertices[part.triangles]
    across = np.cross(targets[:, 1] - targets[:, 0], targets[:, 2] - targets[:, 0])
    area_m2 = np.linalg.norm(across, axis=1) / 2.0
    if not sources:
        return _Placement(np.full(len(targets), -1), np.full((len(targets), 3, 2), 0.5), area_m2)
    corners = np.concatenate([s.vertices[s.triangles] for s in sources])
    tile = np.concatenate([np.full(len(s.triangles), _find(atlas, s.image)) for s in sources])
    texcoords = np.concatenate(
        [np.zeros((len(s.triangles), 3, 2)) if s.uv is None else s.uv for s in sources]
    )
    nearest = _find_nearest(targets.mean(axis=1), corners)
    uv = _extrapolate(targets, corners[nearest], texcoords[nearest])
    uv[tile[nearest] < 0] = 0.5
    return _Placement(tile[nearest], uv, area_m2)


def _place_on_atlas(placement: _Placement, count: int) -> Float64Array:
    """Compute coordinates (m, 3, 2) in widths of an atlas of tiles; its upper edge is 0."""
    tile = np.where(placement.tile < 0, count - 1, placement.tile)
    across = (placement.uv[..., 0] + tile[:, None]) / count
    return np.stack([across, (placement.uv[..., 1] - 1.0) / count], axis=-1)


def _find(atlas: Sequence[Uint8Array], image: Uint8Array | None) -> int:
    return next((n for n, other in enumerate(atlas) if other is image), -1)


def _find_nearest(points: Float64Array, corners: Float64Array) -> NDArray[np.int64]:
    """Find the triangles (m, 3, 3) nearest to points (n, 3), by some points of each."""
    samples = np.concatenate([(corners * w[:, None]).sum(axis=1) for w in _SAMPLES])
    samples = samples.astype(np.float32)
    found: list[NDArray[np.int64]] = []
    for chunk in np.array_split(points.astype(np.float32), len(points) // _CHUNK + 1):
        distance = np.zeros((len(chunk), len(samples)), dtype=np.float32)
        for axis in range(3):
            distance += (chunk[:, None, axis] - samples[None, :, axis]) ** 2
        found.append(np.argmin(distance, axis=1) % len(corners))
    return np.concatenate(found)


def _extrapolate(
    targets: Float64Array, corners: Float64Array, texcoords: Float64Array
) -> Float64Array:
    """Compute coordinates (m, 3, 2) in [0, 1] of targets (m, 3, 3) in the planes of triangles.

    Given coordinates (m, 3, 2) of the triangles may count from any copy of the image.
    """
    first, second = (corners[:, n] - corners[:, 0] for n in (1, 2))
    offset = targets - corners[:, :1]
    aa, ab, bb = ((x * y).sum(axis=1) for x, y in ((first, first), (first, second), (second,) * 2))
    oa, ob = ((offset * edge[:, None]).sum(axis=2) for edge in (first, second))
    determinant = np.maximum(aa * bb - ab * ab, 1e-18)[:, None]
    s = np.clip((oa * bb[:, None] - ob * ab[:, None]) / determinant, -_FARTHEST, 1 + _FARTHEST)
    t = np.clip((ob * aa[:, None] - oa * ab[:, None]) / determinant, -_FARTHEST, 1 + _FARTHEST)
    step_s, step_t = (texcoords[:, n] - texcoords[:, 0] for n in (1, 2))
    uv = texcoords[:, :1] + s[..., None] * step_s[:, None] + t[..., None] * step_t[:, None]
    uv = uv - np.floor(texcoords.mean(axis=1))[:, None]
    margin = 1.0 / IMAGE_PX
    return np.clip(uv, margin, 1.0 - margin)


def _draw_atlas(images: Sequence[Uint8Array], count: int, *, is_grey: bool) -> Uint8Array:
    """Draw images side by side (IMAGE_PX, count * IMAGE_PX, 3); paint varies in tone alone."""
    atlas = np.zeros((IMAGE_PX, count * IMAGE_PX, 3), dtype=np.uint8)
    for number, image in enumerate(images):
        small = cv2.resize(image, (IMAGE_PX, IMAGE_PX), interpolation=cv2.INTER_AREA)
        if is_grey:
            small = cv2.cvtColor(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        atlas[:, number * IMAGE_PX : (number + 1) * IMAGE_PX] = small
    return atlas


def _compute_mean(color: Uint8Array, joined: _Placement) -> tuple[float, float, float]:
    """Compute the mean light (3,) of an atlas on the triangles with an image."""
    shown = joined.tile >= 0
    weight = np.maximum(joined.area_m2[shown], 1e-12)
    total = np.zeros(3)
    for place in _SAMPLES:
        at = (joined.uv[shown] * place[:, None]).sum(axis=1)
        column = ((at[:, 0] + joined.tile[shown]) * IMAGE_PX).astype(int)
        row = ((1.0 - at[:, 1]) * IMAGE_PX).astype(int)
        light = LINEAR_FROM_SRGB[color[row, column]]
        total += (light * weight[:, None]).sum(axis=0) / weight.sum() / len(_SAMPLES)
    red, green, blue = np.maximum(total, 1e-3).tolist()
    return red, green, blue


def _to_srgb(light: tuple[float, float, float]) -> Uint8Array:
    """Find the bytes (3,) of sRGB nearest to a light."""
    return np.abs(LINEAR_FROM_SRGB - np.array(light)[:, None]).argmin(axis=1).astype(np.uint8)


def _compute_width(joined: _Placement, count: int) -> float:
    """Compute the width in metres at which an atlas keeps the area of triangles."""
    shown = joined.tile >= 0
    placed = _place_on_atlas(joined, count)[shown]
    a, b = placed[:, 1] - placed[:, 0], placed[:, 2] - placed[:, 0]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2.0
    return float(np.sqrt(joined.area_m2[shown].sum() / max(area, 1e-12)))
