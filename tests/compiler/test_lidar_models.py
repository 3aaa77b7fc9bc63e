"""LiDARs of rigs by the names of models."""

from pathlib import Path

import pytest

from advercity.compiler import load_library
from advercity.compiler.crossing import compile_library
from advercity.compiler.explain import explain_spec
from advercity.compiler.library import load_declaration
from advercity.errors import InputError
from tests.compiler.conftest import Write

MODEL = """
kind: lidar_model
id: two_beams
lidar:
  channels: 2
  elevations_deg: [1, -2]
  azimuths: 100
  range_m: 60
  receiver: {range_at_10_percent_m: 30, white_level: 100}
"""
RIG = """
kind: rig
id: one_camera
vehicle:
  camera: {mounts: [{x_m: 1, z_m: 1.5}]}
  lidar: {model: two_beams, mount: {z_m: 2}, range_m: 50, receiver: {white_level: 110}}
  more_lidars:
    rear: {model: two_beams}
roadside_unit: {camera: {mounts: [{}]}, lidar: {}}
"""


def test_a_lidar_has_the_figures_of_its_model_that_the_rig_does_not_give(write: Write) -> None:
    library = write(model=MODEL, rig=RIG)
    spec, *_ = compile_library(library)
    lidar, rear = spec.agents[0].sensors.lidars
    assert (lidar.model, lidar.elevations_deg, lidar.range_m) == ("two_beams", (1, -2), 50)
    assert lidar.receiver.range_at_10_percent_m == 30
    assert (lidar.receiver.white_level, rear.receiver.white_level) == (110, 100)
    assert (lidar.mount.z_m, rear.range_m) == (2, 60)
    origins = {item.path: item.text for item in explain_spec(spec, load_library(library))}
    of_lidar = "agents.0.sensors.lidar"
    assert origins[f"{of_lidar}.range_m"] == f"{library}/rig.yaml:6:55"
    assert origins[f"{of_lidar}.azimuths"] == f"{library}/model.yaml:7:13"


def test_a_rig_alone_finds_models_beside_it_and_in_the_library(tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text(MODEL)
    path = tmp_path / "rig.yaml"
    path.write_text(RIG.replace("rear: {model: two_beams}", "rear: {model: hdl_64e}"))
    rig = load_declaration(path).declaration.model_dump()
    assert rig["vehicle"]["lidar"]["channels"] == 2
    assert rig["vehicle"]["more_lidars"]["rear"]["channels"] == 64


@pytest.mark.parametrize(
    ("of_model", "of_rig", "azimuths"),
    [
        ("", "rate_hz: 20", 50),
        ("", "rate_hz: 10 Hz", 100),
        ("", "rate_hz: 5", 200),
        ("", "rate_hz: 20, azimuths: 90", 90),
        ("rate_hz: 20", "rate_hz: 5", 400),
        ("rate_hz: 20", "range_m: 40", 100),
    ],
)
def test_a_head_that_turns_faster_fires_less_often_a_turn(
    write: Write, of_model: str, of_rig: str, azimuths: int
) -> None:
    model = MODEL.replace("  azimuths: 100\n", f"  azimuths: 100\n  {of_model}\n")
    rig = RIG.replace("rear: {model: two_beams}", f"rear: {{model: two_beams, {of_rig}}}")
    spec, *_ = compile_library(write(model=model, rig=rig))
    assert spec.agents[0].sensors.lidars[1].azimuths == azimuths


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "lidar: {model: two_beams, mount",
            "lidar: {model: two_beam, mount",
            "rig.yaml:6:18: vehicle.lidar.model: unknown LiDAR model 'two_beam'; did you mean",
        ),
        (
            "rear: {model: two_beams}",
            "rear: {model: two_beams, channels: 3}",
            "vehicle.more_lidars.rear.elevations_deg: has 2 values for 3 channels; give one for",
        ),
        (
            "rear: {model: two_beams}",
            "rear: {model: two_beams, channel_table: hdl_32e}",
            "are given, and so is channel_table: hdl_32e; give one of both",
        ),
        ("lidar: {}", "lidar: {azimuth_offsets_deg: [1]}", "have no elevations; give elevations"),
        (
            "lidar: {}",
            "lidar: {receiver: {stray_light_db: -10 dB}}",
            "-10 dB",
        ),
        (
            "  range_m: 60",
            "  model: other",
            "model.yaml:8:10: lidar.model: is for rigs; remove it; models build on others",
        ),
    ],
)
def test_models_that_do_not_fit_are_refused(write: Write, old: str, new: str, message: str) -> None:
    files = {name: text.replace(old, new) for name, text in {"model": MODEL, "rig": RIG}.items()}
    with pytest.raises(InputError) as caught:
        compile_library(write(**files))
    assert message in str(caught.value)
