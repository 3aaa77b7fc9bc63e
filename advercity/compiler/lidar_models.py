"""LiDARs of rigs by the names of models: figures missing in the rig are the model's."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, cast

from advercity_dsl.base import ValuePath
from advercity_dsl.units import Hertz
from pydantic import TypeAdapter, ValidationError

from advercity.compiler.extends import (
    Documents,
    ResolvedDeclaration,
    merge_mappings,
    resolve_extends,
)
from advercity.compiler.rig_sensors import iterate_sensors
from advercity.compiler.shipped_library import suggest_declaration
from advercity.compiler.source import SourceDocument, iterate_values, replace_values
from advercity.diagnostics import DiagnosticsError

KIND = "lidar_model"
MODEL_RATE_HZ = 10.0
"""Scans per second for which a model gives `azimuths`, unless it gives a rate of its own."""


def names_lidar_model(data: Any) -> bool:
    """Return whether a LiDAR in the data of a rig names a model."""
    return next(_iterate_named(data), None) is not None


def apply_lidar_models(rig: ResolvedDeclaration, documents: Documents) -> ResolvedDeclaration:
    """Fill in the model's figures in every LiDAR of a rig with a `model`.

    Raises:
        DiagnosticsError: No model has the name.
    """
    data, origins = rig.data, dict(rig.origins)
    for value_path, written in _iterate_named(rig.data):
        model = _find_model(rig, value_path, written["model"], documents)
        figures: Any = model.data.get("lidar")
        # A model with another shape has errors of its own, which are reported at its file.
        if not isinstance(figures, dict):
            continue
        inherited = _adapt_to_rate(cast(dict[str, Any], figures), written)
        merged = merge_mappings(inherited, written)
        data = replace_values(data, {value_path: merged})
        document = _move_values(model.document, ("lidar",), value_path)
        for path, _ in iterate_values(inherited):
            if not rig.has_value((*value_path, *path)):
                origins[(*value_path, *path)] = document
    return replace(rig, data=data, origins=origins)


def _iterate_named(data: Any) -> Iterator[tuple[ValuePath, dict[str, Any]]]:
    """Yield the LiDARs with a `model` in a rig's data, with their paths."""
    for path, lidar in iterate_sensors(data, "lidar"):
        if isinstance(lidar.get("model"), str):
            yield path, lidar


def _adapt_to_rate(figures: dict[str, Any], written: dict[str, Any]) -> dict[str, Any]:
    """Give a scan the beams fired in its period by a model, unless the rig gives them.

    Lasers fire at a pace of their own: a head that turns twice as fast fires half as often a turn.
    """
    beams = figures.get("azimuths")
    rates = [item.get("rate_hz", MODEL_RATE_HZ) for item in (figures, written)]
    if "rate_hz" not in written or not isinstance(beams, int):
        return figures
    try:
        of_model, of_rig = (TypeAdapter[float](Hertz).validate_python(rate) for rate in rates)
    except ValidationError:
        return figures  # reported where it is given
    return figures | {"azimuths": round(beams * of_model / of_rig)} if of_rig else figures


def _find_model(
    rig: ResolvedDeclaration, value_path: ValuePath, name: str, documents: Documents
) -> ResolvedDeclaration:
    if (KIND, name) not in documents:
        known = [other for kind, other in documents if kind == KIND]
        hint = suggest_declaration(KIND, name, known)
        message = f"unknown LiDAR model '{name}'"
        raise DiagnosticsError(rig.build_diagnostic((*value_path, "model"), message, hint=hint))
    return resolve_extends((KIND, name), documents)


def _move_values(document: SourceDocument, old: ValuePath, new: ValuePath) -> SourceDocument:
    """Return a document whose values below one path are found below another."""
    moved = {
        (*new, *path[len(old) :]): position
        for path, position in document.positions.items()
        if path[: len(old)] == old
    }
    return replace(document, positions=moved, key_positions={})
