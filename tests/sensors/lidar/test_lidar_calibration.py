"""The LiDAR models against published figures, as the documentation's table has them."""

import sys
from pathlib import Path
from types import ModuleType

import pytest
from advercity_dsl import LidarModel

from advercity.sensors.measurements import PointKind
from tests.sensors.lidar.builders import measure, misses, vary
from tests.shipped import LIBRARY

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def calibration() -> ModuleType:
    sys.path.insert(0, str(DOCS))
    try:
        import make_lidar_calibration  # type: ignore[import-not-found]
    finally:
        sys.path.remove(str(DOCS))
    return make_lidar_calibration


def test_the_table_in_the_documentation_is_current(calibration: ModuleType) -> None:
    page = calibration.format_page(calibration.compare_all())
    assert page == (DOCS / "lidar_calibration.md").read_text(encoding="utf-8")


def test_parameters_that_were_fitted_reproduce_their_figures(calibration: ModuleType) -> None:
    fitted = [item for item in calibration.compare_all() if item.measurement.use == "fit"]
    assert len(fitted) == 8
    for item in fitted:
        measured = item.measurement
        if measured.at_most:
            assert item.fits
        else:
            assert item.model == pytest.approx(measured.published, rel=measured.within)


def test_predictions_that_the_documentation_claims_are_met(calibration: ModuleType) -> None:
    tested = [item for item in calibration.compare_all() if item.measurement.use == "test"]
    misfits = {item.measurement.name.partition(",")[0] for item in tested if not item.fits}
    assert misfits == {
        "HDL-32E",
        "HDL-64E S2 and S3 in a fog chamber",
        "OS1",
        "a lidar in dense fog",
        "attenuation by rain of 25 mm/h over a laser link",
    }


@pytest.mark.parametrize("model", ["hdl_32e", "vls_128"])
def test_fog_adds_no_points_with_gain_control(model: str) -> None:
    """To the sky, where fog of 63 m had an ideal sensor report a point for every beam."""
    shipped = LIBRARY.get_declarations(LidarModel)[model].lidar
    lidar = vary(shipped, motion_distortion=False, sub_rays=1)
    found = measure(lidar, misses(lidar.azimuths * lidar.channels), fog={"mor_m": 63})
    assert set(found.kind) <= {PointKind.FOG}
    assert len(found.points) < 0.01 * lidar.azimuths * lidar.channels
