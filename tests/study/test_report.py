"""The study of folders as its user runs it."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_benchmark.study.picture_features import (
    IMAGENET_DEVIATION,
    IMAGENET_MEAN,
    load_network,
)

from tests.command_line import Command

HINT = "no study is made; `scripts/setup_peers` installs scikit-learn"


def encode_field(number: int, content: bytes | int) -> bytes:
    """A field of a protocol buffer."""
    if isinstance(content, int):
        return bytes([number << 3]) + encode_number(content)
    return bytes([number << 3 | 2]) + encode_number(len(content)) + content


def encode_number(number: int) -> bytes:
    low = number & 127
    return bytes([low]) if number < 128 else bytes([low | 128]) + encode_number(number >> 7)


def encode_batch(name: bytes, *sizes: int) -> bytes:
    """Name and type of a batch of float32 arrays."""
    dimensions = [encode_field(2, b"n"), *(encode_field(1, size) for size in sizes)]
    shape = b"".join(encode_field(1, item) for item in dimensions)
    tensor = encode_field(1, 1) + encode_field(2, shape)
    return encode_field(1, name) + encode_field(2, encode_field(1, tensor))


@pytest.fixture
def network(tmp_path: Path) -> Path:
    """A network whose features are the mean red, green and blue."""
    node = encode_field(1, b"x") + encode_field(2, b"y") + encode_field(4, b"GlobalAveragePool")
    graph = encode_field(1, node) + encode_field(2, b"g")
    graph += encode_field(11, encode_batch(b"x", 3, 224, 224))
    graph += encode_field(12, encode_batch(b"y", 3, 1, 1))
    path = tmp_path / "mean.onnx"
    opset = encode_field(2, 13)
    path.write_bytes(encode_field(1, 8) + encode_field(7, graph) + encode_field(8, opset))
    return path


def write_street(folder: Path, *, brightness: int) -> None:
    generator = np.random.default_rng(brightness)
    for kind in ("image_2", "velodyne"):
        (folder / kind).mkdir(parents=True)
    for number in range(8):
        picture = generator.integers(brightness, brightness + 40, (30, 60, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"image_2/{number}.png"), picture)
        points = generator.normal(scale=brightness, size=(50, 4)).astype("<f4")
        points[:, 3] = 0.5
        (folder / f"velodyne/{number}.bin").write_bytes(points.tobytes())


def test_features_are_the_output_of_the_network_of_a_file(network: Path) -> None:
    picture = np.full((1, 224, 224, 3), [255, 51, 0], np.uint8)
    expected = (np.array([1.0, 0.2, 0.0]) - IMAGENET_MEAN) / IMAGENET_DEVIATION
    np.testing.assert_allclose(load_network(str(network))(picture), [expected], rtol=1e-3)


@pytest.fixture
def streets(tmp_path: Path) -> tuple[Path, Path]:
    """A dark and a bright recording, where what a study needs is installed."""
    pytest.importorskip("sklearn", reason=HINT)
    dark, bright = tmp_path / "dark", tmp_path / "bright"
    write_street(dark, brightness=10)
    write_street(bright, brightness=90)
    return dark, bright


def test_a_study_writes_tables_and_plots(
    tmp_path: Path,
    streets: tuple[Path, Path],
    network: Path,
    advercity: Command,
) -> None:
    out = tmp_path / "study"
    options = "--network", network, "--output", out
    code, printed, said = advercity("study", f"ours={streets[0]}", streets[1], *options)
    assert (code, printed) == (0, f"{out}\n")
    assert "ours: kitti, 8 pictures, 8 sweeps" in said
    assert sorted(path.name for path in out.iterdir()) == [
        "embedding.png",
        "lidar.csv",
        "lidar.png",
        "lidar_distances.csv",
        "picture_distances.csv",
    ]
    with (out / "picture_distances.csv").open() as stream:
        rows = {(row["one"], row["other"]): float(row["frechet"]) for row in csv.DictReader(stream)}
    assert rows["ours", "bright"] > 100.0 * max(rows["ours", "ours"], rows["bright", "bright"])
    with (out / "lidar.csv").open() as stream:
        far = {row["name"]: float(row["far_range_m"]) for row in csv.DictReader(stream)}
    assert far["bright"] / far["ours"] == pytest.approx(9.0, rel=0.1)


def test_a_study_that_may_not_write_one_file_writes_none(
    tmp_path: Path,
    streets: tuple[Path, Path],
    network: Path,
    advercity: Command,
) -> None:
    out = tmp_path / "study"
    out.mkdir()
    (out / "lidar.png").write_text("mine")
    options = "--network", network, "--output", out
    code, _, said = advercity("study", *streets, *options)
    assert (code, (out / "lidar.png").read_text()) == (2, "mine")
    assert "lidar.png: exists" in said
    assert [path.name for path in out.iterdir()] == ["lidar.png"]


def test_what_cannot_be_studied_is_refused_in_one_line(tmp_path: Path, advercity: Command) -> None:
    write_street(tmp_path / "street", brightness=50)
    alone = advercity("study", tmp_path / "street")
    unknown = advercity(
        "study", f"a={tmp_path / 'street'}", tmp_path / "street", "--network", "resnet"
    )
    assert alone.err.endswith(
        "error: no two of these folders have pictures, or LiDAR sweeps, to compare\n"
    )
    assert unknown.err.endswith(
        "error: no network 'resnet'; there is efficientnet-lite0, or name a file *.onnx\n"
    )
    assert alone.code == unknown.code == 2
