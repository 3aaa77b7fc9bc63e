"""V2X-R's folders, walked as its loaders do."""

from pathlib import Path

import pytest
from advercity_exports.v2xr import RADAR_POINT
from numpy.testing import assert_allclose

from advercity.dataset.cloud_files import read_pcd
from advercity.dataset.reader import open_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.geometry import poses


def test_agents_without_a_radar_are_refused(radar_dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rsu1 has no radar, as v2xr needs of every agent"):
        export_dataset("v2xr", radar_dataset, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_radars_are_in_the_frame_of_the_lidar(all_radars_dataset: Path, tmp_path: Path) -> None:
    folder = export_dataset("v2xr", all_radars_dataset, tmp_path / "out").output
    scenario = open_dataset(all_radars_dataset).scenarios[0]
    agents = folder / "train" / scenario.path.name
    # As the loaders of OPV2V, which V2X-R's derive from, list agents and frames.
    names = sorted(path.name for path in agents.iterdir())
    assert names == ["+101", "-1", "-2", "102", "103"]
    for agent in names:
        frames = sorted(path.stem for path in (agents / agent).glob("*.yaml"))
        assert frames == ["000060", "000061"]
        for frame in frames:
            for suffix in (".pcd", "_radar.pcd", *(f"_camera{number}.png" for number in range(4))):
                assert (agents / agent / f"{frame}{suffix}").is_file()
    view = scenario[0]["cav1"]
    assert (agents / "+101/000060.pcd").read_bytes() == view.path(".pcd").read_bytes()
    radar = read_pcd(agents / "+101/000060_radar.pcd", RADAR_POINT)
    # The radar is 2.5 m ahead of the LiDAR and 1.4 m below it; left-handed, y is to the right.
    assert_allclose([radar["x"][0], radar["y"][0], radar["z"][0]], [22.5, -15.0, -1.4], atol=1e-5)
    assert_allclose(radar["velocity"][0], view.radar["velocity"][0])
    assert (radar["rgb"][0] >> 16) == round(25.0 / 60.0 * 255.0)
    lidar_from_radar = poses.invert_pose(view.world_from_lidar) @ view.load_radar_pose(0)
    assert_allclose(lidar_from_radar[:3, 3], [2.5, 0.0, -1.4], atol=1e-6)
    assert len(read_pcd(agents / "-1/000060_radar.pcd", RADAR_POINT)) == 0
