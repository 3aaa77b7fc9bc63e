"""The formats of this distribution, as its entry points name them."""

from advercity.exports.registry import ExportFormat, Quantifier


def _declare(
    name: str, module: str, needs: dict[str, Quantifier] | None = None, **options: tuple[str, ...]
) -> ExportFormat:
    return ExportFormat(name, f"advercity_exports.{module}:list_pieces", options, needs or {})


ADVER_CITY = _declare("adver_city", "adver_city")
CALIBRATION = _declare("calibration", "calibration", {"camera": any})
COCO = _declare("coco", "coco", {"camera": any})
CROISSANT = _declare("croissant", "croissant")
KITTI = _declare("kitti", "kitti", {"camera": all, "lidar": all})
MCAP = _declare("mcap", "mcap_recording", schemas=("foxglove", "ros2"))
NUSCENES = _declare("nuscenes", "nuscenes", key_frames=("all", "2hz"))
OPENLABEL = _declare("openlabel", "openlabel")
OPENSCENARIO = _declare("openscenario", "openscenario")
OSI = _declare("osi", "osi_trace")
V2XR = _declare("v2xr", "v2xr", {"lidar": all, "radar": all})
WEBDATASET = _declare("webdataset", "webdataset_shards", {"lidar": all})
