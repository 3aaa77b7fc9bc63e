"""The formats of this distribution, as its entry points name them."""

from advercity.exports.registry import ExportFormat


def _declare(name: str, module: str, **options: tuple[str, ...]) -> ExportFormat:
    return ExportFormat(name, f"advercity_exports.{module}:list_pieces", options)


ADVER_CITY = _declare("adver_city", "adver_city")
CALIBRATION = _declare("calibration", "calibration")
COCO = _declare("coco", "coco")
CROISSANT = _declare("croissant", "croissant")
KITTI = _declare("kitti", "kitti")
MCAP = _declare("mcap", "mcap_recording", schemas=("foxglove", "ros2"))
NUSCENES = _declare("nuscenes", "nuscenes", key_frames=("all", "2hz"))
OPENLABEL = _declare("openlabel", "openlabel")
OPENSCENARIO = _declare("openscenario", "openscenario")
OSI = _declare("osi", "osi_trace")
V2XR = _declare("v2xr", "v2xr")
WEBDATASET = _declare("webdataset", "webdataset_shards")
