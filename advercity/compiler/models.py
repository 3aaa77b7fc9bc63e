"""Models that a catalogue names by their files: the spec knows them by checksum."""

import hashlib
from pathlib import Path

from advercity_dsl import Blueprint, Catalogue

from advercity.compiler.extension import Resolved
from advercity.compiler.problems import ProblemsError

GLB_MAGIC = b"glTF"


def with_checksums(catalogue: Catalogue, source: Resolved) -> Catalogue:
    """The catalogue, each model file of its blueprints with its SHA-256.

    Raises:
        ProblemsError: A file is missing, or is no GLB.
    """
    blueprints = {
        name: _with_checksum(name, blueprint, source)
        for name, blueprint in catalogue.blueprints.items()
    }
    return catalogue.model_copy(update={"blueprints": blueprints})


def _with_checksum(name: str, blueprint: Blueprint, source: Resolved) -> Blueprint:
    model = blueprint.model
    if model is None or model.file is None:
        return blueprint
    where = ("blueprints", name, "model", "file")
    path: Path = source.document_of(where).path.parent / model.file
    try:
        content = path.read_bytes()
    except OSError as error:
        message = f"'{model.file}' cannot be read: {error.strerror}"
        hint = "a model's file lies beside the declaration"
        raise ProblemsError.of(source.problem(where, message, hint=hint)) from error
    if not content.startswith(GLB_MAGIC):
        message = f"'{model.file}' is not a GLB file"
        hint = "export the model as binary glTF"
        raise ProblemsError.of(source.problem(where, message, hint=hint))
    digest = hashlib.sha256(content).hexdigest()
    known = model.model_copy(update={"sha256": digest})
    return blueprint.model_copy(update={"model": known})
