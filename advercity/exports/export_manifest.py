"""The manifest of an export: its inputs, and every file with its checksum."""

import hashlib
from pathlib import Path
from typing import Annotated, Literal, Self

from advercity_dsl import Model
from advercity_dsl.base import is_empty
from pydantic import AfterValidator, Field, ValidationError, model_validator

from advercity import __version__
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.reader import Dataset
from advercity.dataset.scenario_folders import EXPORT_FILE
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes
from advercity.errors import RunError, describe_cause
from advercity.exports.pieces import PATH_PATTERN
from advercity.exports.registry import find_export_format

OTHER_SOURCE_HINT = "`fresh` starts over, another `output` leaves it alone"


def _check_path(path: str) -> str:
    if not PATH_PATTERN.fullmatch(path):
        raise ValueError(f"{path!r:.60} is no path within an export")
    return path


ExportPath = Annotated[str, AfterValidator(_check_path)]


class ExportRecord(FileRecord):
    """Size and checksum of a written file.

    Attributes:
        piece: Name of the piece it belongs to.
    """

    piece: str


class ExportManifest(Model):
    """The written files of an export; the same dataset gives the same text.

    Attributes:
        export_version: Version of these fields.
        format: Name of the format.
        options: Options of the format, by name.
        version: Version of advercity.
        code_sha256: Checksum of its sources.
        scenarios: Checksums of the identities of the scenarios, by their names.
        edited: Checksums of files changed after their run and exported so, by scenario and path.
        complete: Whether everything in the dataset is written.
        pieces: Inputs of the finished pieces, by their names.
        files: Records by path within the export.
    """

    export_version: Literal[1] = 1
    format: str
    options: dict[str, str]
    version: str
    code_sha256: str
    scenarios: dict[str, str]
    edited: dict[str, str] = Field(default_factory=dict[str, str], exclude_if=is_empty)
    complete: bool = False
    pieces: dict[str, str] = Field(default_factory=dict[str, str])
    files: dict[ExportPath, ExportRecord] = Field(default_factory=dict[str, ExportRecord])

    @model_validator(mode="after")
    def _check_pieces(self) -> Self:
        # A file of an unknown piece would be removed, and not be made again with its own.
        others = {record.piece for record in self.files.values()} - self.pieces.keys()
        if others:
            raise ValueError(f"{min(others)!r:.60} is no piece of this export")
        return self

    @staticmethod
    def for_dataset(dataset: Dataset, format: str, options: dict[str, str]) -> "ExportManifest":
        """Describe the export of a dataset by this version of advercity, without files."""
        return ExportManifest(
            format=format,
            options=options,
            version=__version__,
            code_sha256=find_export_format(format).compute_code_digest(),
            scenarios={
                one.path.name: hashlib.sha256(
                    one.manifest.identity.model_dump_json().encode()
                ).hexdigest()
                for one in dataset.scenarios
            },
        )

    def check_continues(self, former: "ExportManifest", where: Path) -> None:
        """Check whether this export may continue a former one.

        It may if the dataset has got more frames or scenarios meanwhile.

        Raises:
            RunError: It may not; the text gives the reason and a remedy.
        """
        differences = [
            f"{name}: {before}, {now}"
            for name, before, now in (
                ("format", former.format, self.format),
                ("options", former.options, self.options),
                ("version", former.version, self.version),
                ("code of advercity", former.code_sha256[:12], self.code_sha256[:12]),
            )
            if before != now
        ]
        others = [
            name for name, digest in former.scenarios.items() if self.scenarios.get(name) != digest
        ]
        if others:
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            differences.append(f"{others[0]}{more}: not in the dataset, or made again since")
        if differences:
            raise RunError(
                f"{where}: was exported from another dataset, or otherwise"
                f" ({'; '.join(differences)}); {OTHER_SOURCE_HINT}"
            )

    def to_json(self) -> bytes:
        """Format it as JSON: files sorted, without times and machine paths, with a newline."""
        return self.model_dump_json(indent=1, exclude_none=True).encode() + b"\n"

    @staticmethod
    def load(folder: Path) -> "ExportManifest | None":
        """Load the manifest of an export, without the journal; None if the folder has none.

        Raises:
            InputError: It is no JSON.
            RunError: It cannot be read, or is of another version.
        """
        path = folder / EXPORT_FILE
        hint = "it is the only list of the files: delete the folder, or choose another `output`"
        try:
            document = parse_json(read_bytes(path, max_bytes=MAX_JSON_BYTES), path, hint=hint)
            return ExportManifest.model_validate(document)
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
        except ValidationError as error:
            raise RunError(
                f"{path}: not the manifest of an export of this version; {hint}"
            ) from error
