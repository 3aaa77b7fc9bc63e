"""Cameras of rigs by calibration files, which give the image's size, intrinsics and lens."""

import logging
import re
from dataclasses import replace
from typing import Any, cast

from advercity_dsl.base import ValuePath, suggest_name

from advercity.compiler.calibration_formats import (
    LEFT_OUT,
    Calibration,
    CameraInfo,
    KalibrCamera,
)
from advercity.compiler.extends import ResolvedDeclaration
from advercity.compiler.rig_sensors import iterate_sensors
from advercity.compiler.source import SourceDocument, parse_document, replace_values
from advercity.compiler.validation import validate_model
from advercity.diagnostics import DiagnosticsError
from advercity.documents import read_text

CALIBRATIONS_FOLDER = "calibrations"
"""Folder in a library whose files are no declarations."""
MAX_BYTES = 100_000
"""Ten times a chain of eight cameras."""
GIVEN_FIELDS = ("width_px", "height_px", "horizontal_fov_deg", "intrinsics", "lens")
"""Fields of a camera given by a calibration."""
OPENCV_SYNTAX = re.compile(r"^%YAML:1\.0|!!opencv-matrix", re.MULTILINE)
"""Parts of a file by OpenCV outside of YAML 1.2."""

_logger = logging.getLogger(__name__)


def apply_calibrations(rig: ResolvedDeclaration) -> ResolvedDeclaration:
    """Fill in the size, intrinsics and lens of every camera of a rig with a calibration.

    Raises:
        DiagnosticsError: A file is missing, too large, outside the rig's folder, or has unknown
            parts.
    """
    data = rig.data
    for value_path, camera in iterate_sensors(rig.data, "camera"):
        if not isinstance(camera.get("calibration"), str):
            continue
        for name in GIVEN_FIELDS:
            if name in camera:
                message, hint = "is given by `calibration`, too", "leave out one of both"
                place = (*value_path, name)
                raise DiagnosticsError(rig.build_diagnostic(place, message, hint=hint, key=True))
        document = _read_calibration(rig, value_path, camera)
        model = CameraInfo if "image_width" in document.data else KalibrCamera
        found = validate_model(model, document, previous=document.diagnostics)
        _list_left_out(found, document)
        data = replace_values(data, {value_path: camera | found.to_camera()})
    return replace(rig, data=data)


def _read_calibration(
    rig: ResolvedDeclaration, value_path: ValuePath, camera: dict[str, Any]
) -> SourceDocument:
    """Read the calibration of one camera; of a chain, the part of the named camera."""
    place = (*value_path, "calibration")
    folder = rig.find_document(place).path.parent
    path = folder / camera["calibration"]
    if not path.resolve().is_relative_to(folder.resolve()):
        message = f"'{camera['calibration']}' is not in the folder of the rig"
        hint = f"put it into '{CALIBRATIONS_FOLDER}' next to the rig"
        raise DiagnosticsError(rig.build_diagnostic(place, message, hint=hint))
    try:
        text = read_text(path, max_bytes=MAX_BYTES)
    except DiagnosticsError as error:
        problem = error.diagnostics[0]
        message = f"'{camera['calibration']}': {problem.message}"
        raise DiagnosticsError(rig.build_diagnostic(place, message, hint=problem.hint)) from None
    # Blanks in their place keep lines and columns.
    text = OPENCV_SYNTAX.sub(lambda found: " " * len(found[0]), text)
    document = parse_document(path, text)
    chain, name = _find_chain(document), camera.get("calibrated_camera")
    if name is None and len(chain) > 1:
        message = f"'{camera['calibration']}' has {len(chain)} cameras"
        hint = f"choose one, as `calibrated_camera: {chain[0]}`"
        raise DiagnosticsError(rig.build_diagnostic(place, message, hint=hint))
    if name is not None and name not in chain:
        message = f"'{camera['calibration']}' has no camera '{name}'"
        place, hint = (*value_path, "calibrated_camera"), suggest_name(str(name), chain)
        raise DiagnosticsError(rig.build_diagnostic(place, message, hint=hint))
    return document.select((name or chain[0],)) if chain else document


def _find_chain(document: SourceDocument) -> list[str]:
    """Find the names of the cameras of a chain; none in other calibrations."""
    data: Any = document.data
    if not isinstance(data, dict):
        return []
    parts = cast(dict[str, Any], data)
    return list(parts) if all(isinstance(part, dict) for part in parts.values()) else []


def _list_left_out(found: Calibration, document: SourceDocument) -> None:
    for name, reason in LEFT_OUT.items():
        if name in found.model_fields_set:
            line = document.find_position((name,), key=True).line
            _logger.warning("%s:%d: left out: %s; %s", document.path, line, name, reason)
