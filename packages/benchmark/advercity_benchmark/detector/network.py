"""The network: an encoder of points or images, attention over stations, and a head for middles.

Pillars after PointPillars (Lang and others, CVPR 2019), images sampled at the cells of the map
after Simple-BEV (Harley and others, ICRA 2023), middles after CenterPoint (Yin and others, CVPR
2021), attention over the stations of each cell after OPV2V (Xu and others, ICRA 2022).
"""

import math

import numpy as np

from advercity.geometry.arrays import Float32Array
from advercity.geometry.poses import Matrix, invert_pose
from advercity_benchmark.detector.boxes import BOX_CHANNELS, Area, compute_cell_centres
from advercity_benchmark.detector.images import HEIGHTS_M, StationImages
from advercity_benchmark.detector.pytorch import Tensor, functional, nn, torch

PILLAR_M = 0.5
LOWEST_M = -1.0
STEEPEST = 0.1
"""Roads fall less: points lower than this below the ground of the station are mirrored ones."""
GROUND_CELL_M = 4.0
HIGHEST_M = 5.0
"""Over the lowest point around: vehicles on a hill are used, crowns of trees are not."""
PILLAR_FEATURES = 9
_BIAS = -4.0
"""Initial bias of the heat: at first, it finds hardly any object."""


class Pillars(nn.Module):
    """Features of each pillar: the maximum over its points."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layer = nn.Sequential(
            nn.Linear(PILLAR_FEATURES, channels, bias=False),
            nn.BatchNorm1d(channels, eps=1e-3, momentum=0.03),
            nn.ReLU(),
        )
        self.channels = channels

    def forward(self, points: Tensor, area: Area) -> Tensor:
        """Compute a map (1, c, nx, ny) of points (n, 4)."""
        half = points.new_tensor(area)
        shape = [round(2 * side / PILLAR_M) for side in area]
        cells = torch.floor((points[:, :2] + half) / PILLAR_M).long()
        limit = cells.new_tensor(shape)
        inside = ((cells >= 0) & (cells < limit)).all(1)
        inside &= points[:, 2] > LOWEST_M - STEEPEST * points[:, :2].norm(dim=1)
        points, cells = points[inside], cells[inside]
        heights = _compute_heights(points, cells, shape)
        near = heights < HIGHEST_M
        points, cells, heights = points[near], cells[near], heights[near]
        index = cells[:, 0] * shape[1] + cells[:, 1]
        canvas = points.new_zeros(shape[0] * shape[1], self.channels)
        if len(points) > 1:
            described = self._describe(points, cells, index, half, len(canvas))
            values = self.layer(torch.cat([described, heights[:, None]], 1))
            places = index[:, None].expand(-1, self.channels)
            canvas = canvas.scatter_reduce(0, places, values, "amax")
        return canvas.view(1, *shape, self.channels).permute(0, 3, 1, 2)

    def _describe(
        self, points: Tensor, cells: Tensor, index: Tensor, half: Tensor, count: int
    ) -> Tensor:
        """Compute features (n, 8): place in the pillar and to its mean, z, light, points in it."""
        sums = points.new_zeros(count, 4)
        sums.index_add_(0, index, torch.cat([points[:, :3], torch.ones_like(points[:, :1])], 1))
        of_pillar = sums[index]
        means = of_pillar[:, :3] / of_pillar[:, 3:]
        middles = (cells + 0.5) * PILLAR_M - half
        return torch.cat(
            [
                points[:, :2] - middles,
                points[:, :3] - means,
                points[:, 2:4],
                0.2 * torch.log(of_pillar[:, 3:]),
            ],
            1,
        )


def _compute_heights(points: Tensor, cells: Tensor, shape: list[int]) -> Tensor:
    """Compute heights (n,) of points over the lowest one within 4 to 8 m, mostly the ground."""
    pillars = round(GROUND_CELL_M / PILLAR_M)
    sides = [side // pillars for side in shape]
    places = (cells // pillars)[:, 0] * sides[1] + (cells // pillars)[:, 1]
    depths = points.new_full((sides[0] * sides[1],), -math.inf)
    depths = depths.scatter_reduce(0, places, -points[:, 2], "amax").view(1, 1, *sides)
    deepest = functional.max_pool2d(depths, 3, stride=1, padding=1).flatten()
    return points[:, 2] + deepest[places]


def _build_block(before: int, after: int, layers: int, stride: int = 2) -> Tensor:
    """Build convolutions of which the first, with a stride of 2, halves the map."""
    parts: list[Tensor] = []
    for layer in range(layers):
        step = 1 if layer else stride
        parts += [
            nn.Conv2d(after if layer else before, after, 3, step, 1, bias=False),
            nn.BatchNorm2d(after, eps=1e-3, momentum=0.03),
            nn.ReLU(),
        ]
    return nn.Sequential(*parts)


def _build_levels(
    channels: int, widths: tuple[int, ...], *, layers: int, stride: int
) -> tuple[Tensor, Tensor]:
    """Build blocks of convolutions, each on half the map, and their merging layers."""
    before, strides = (channels, *widths), (stride, *[2] * (len(widths) - 1))
    blocks = nn.ModuleList(
        _build_block(first, width, layers, step)
        for first, width, step in zip(before, widths, strides, strict=False)
    )
    return blocks, nn.ModuleList(nn.Conv2d(width, channels, 1) for width in widths)


def _merge_levels(blocks: Tensor, merges: Tensor, level: Tensor) -> Tensor:
    """Compute the features of all blocks, on the map of the first."""
    merged: Tensor = 0.0
    for block, merge in zip(blocks, merges, strict=True):
        level = block(level)
        part = merge(level)
        if torch.is_tensor(merged):
            part = functional.interpolate(part, merged.shape[2:], mode="nearest")
        merged = merged + part
    return functional.relu(merged)


class CloudEncoder(nn.Module):
    """From points to a feature map with a cell for each square metre."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.pillars = Pillars(channels)
        widths = (channels, 2 * channels, 2 * channels)
        self.blocks, self.merge = _build_levels(channels, widths, layers=3, stride=2)

    def forward(self, points: Float32Array, area: Area) -> Tensor:
        """Compute a feature map (1, c, nx, ny) of points (n, 4)."""
        device = self.merge[0].bias.device
        level = self.pillars(torch.from_numpy(points).to(device), area)
        return _merge_levels(self.blocks, self.merge, level)


class CameraEncoder(nn.Module):
    """From images to a feature map with a cell for each square metre.

    A cell has the features of its pixels at several heights, as mean of all cameras, and its place
    relative to the station, since vehicles ahead look different from vehicles beside it.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.stem = _build_block(3, channels, 1)
        widths = (channels, 2 * channels, 2 * channels)
        self.image_blocks, self.image_merge = _build_levels(
            channels, widths[:2], layers=2, stride=2
        )
        self.reduce = nn.Conv2d(len(HEIGHTS_M) * channels + 3, channels, 1)
        self.blocks, self.merge = _build_levels(channels, widths, layers=2, stride=1)

    def forward(self, station: StationImages, area: Area) -> Tensor:
        """Compute a feature map (1, c, nx, ny) of the images of a station."""
        device = self.reduce.bias.device
        colours = torch.from_numpy(station.colours).to(device).float() / 127.5 - 1.0
        places = torch.from_numpy(station.places).to(device)
        features = _merge_levels(self.image_blocks, self.image_merge, self.stem(colours))
        sampled = functional.grid_sample(features, places.flatten(1, 2), align_corners=False)
        cameras = (places.abs() < 1.0).all(-1).sum(0).clamp(min=1)
        mean = sampled.unflatten(2, places.shape[1:3]).sum(0) / cameras
        where = torch.from_numpy(_describe_cells(area)).to(device)
        level = functional.relu(self.reduce(torch.cat([mean.flatten(0, 1), where])[None]))
        return _merge_levels(self.blocks, self.merge, level)


def _describe_cells(area: Area) -> Float32Array:
    """Compute the direction and the distance (3, nx, ny) of cells from the middle."""
    centres = np.moveaxis(compute_cell_centres(area), -1, 0)
    distance_m = np.hypot(*centres)
    return np.stack([*(centres / distance_m), np.log(distance_m) / 4.0]).astype(np.float32)


class Attention(nn.Module):
    """For each cell, the ego's weighted mean of the feature maps of all stations."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.query = nn.Conv2d(channels, channels, 1)
        self.key = nn.Conv2d(channels, channels, 1)
        # At first, the stations with the strongest features in a cell are heard most.
        nn.init.zeros_(self.query.weight)
        nn.init.ones_(self.query.bias)
        nn.init.dirac_(self.key.weight)
        nn.init.zeros_(self.key.bias)

    def forward(self, maps: Tensor, inside: Tensor) -> Tensor:
        """Fuse maps (s, c, nx, ny), the ego's first, where they exist (s, nx, ny)."""
        scores = (self.query(maps[:1]) * self.key(maps)).sum(1) / math.sqrt(maps.shape[1])
        fractions = torch.softmax(scores.masked_fill(~inside, -math.inf), 0)
        return (fractions[:, None] * maps).sum(0, keepdim=True)


class Detector(nn.Module):
    """Encoder, attention and head.

    Args:
        channels: Width of the feature maps.
        has_attention: Whether feature maps of several stations are fused.
        has_cameras: Whether it sees images, else points.
    """

    def __init__(self, channels: int, *, has_attention: bool, has_cameras: bool = False) -> None:
        super().__init__()
        self.has_cameras = has_cameras
        self.encoder = CameraEncoder(channels) if has_cameras else CloudEncoder(channels)
        self.attention = Attention(channels) if has_attention else None
        self.head = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False),
            nn.BatchNorm2d(channels, eps=1e-3, momentum=0.03),
            nn.ReLU(),
            nn.Conv2d(channels, 1 + BOX_CHANNELS, 1),
        )
        with torch.no_grad():
            self.head[-1].bias.zero_()
            self.head[-1].bias[0] = _BIAS

    def encode(self, recorded: Float32Array | StationImages, area: Area) -> Tensor:
        """Compute the feature map (1, c, nx, ny) of a cloud (n, 4), or of images, over an area."""
        return self.encoder(recorded, area)

    def fuse(
        self, maps: list[Tensor], ego_from_stations: list[Matrix], areas: list[Area]
    ) -> Tensor:
        """Fuse feature maps, the ego's first, in the ego's area."""
        if self.attention is None or len(maps) == 1:
            return maps[0]
        warped, inside = [maps[0]], [torch.ones_like(maps[0][0, 0], dtype=torch.bool)]
        for features, pose, area in zip(maps[1:], ego_from_stations[1:], areas[1:], strict=True):
            grid = torch.from_numpy(_locate_cells(pose, areas[0], area)).to(features)
            inside.append((grid.abs() < 1.0).all(-1))
            warped.append(
                functional.grid_sample(features, grid.flip(-1)[None], align_corners=False)
            )
        return self.attention(torch.cat(warped), torch.stack(inside))

    def predict(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Predict heat (1, nx, ny) before the sigmoid, and boxes (8, nx, ny)."""
        maps = self.head(features)[0]
        return maps[:1], maps[1:]


def _locate_cells(ego_from_station: Matrix, area: Area, station_area: Area) -> Float32Array:
    """Locate the ego's cells (nx, ny, 2) in a station's map, whose borders are at -1 and 1."""
    station_from_ego = invert_pose(ego_from_station)
    centres = compute_cell_centres(area) @ station_from_ego[:2, :2].T + station_from_ego[:2, 3]
    return (centres / np.array(station_area)).astype(np.float32)
