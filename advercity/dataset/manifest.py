"""The manifest of a scenario: the inputs of its data, and every file with its checksum."""

import hashlib
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Literal, Self

import numpy as np
from advercity_dsl import Model, Spec
from advercity_dsl.base import is_empty
from advercity_dsl.sensor_kinds import CORE_KINDS, load_sensor_kinds
from advercity_dsl.weather_parts import CORE_PARTS, load_weather_parts
from pydantic import Field, ValidationError, field_validator, model_validator

from advercity import __version__
from advercity.dataset.formats import FORMATS, FrameFileNames
from advercity.dataset.partial_files import FilePath, FileRecord, read_journals
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    MANIFEST_VERSION,
    check_is_readable,
    not_a_scenario_error,
)
from advercity.dataset.weather_truth import WeatherTruth
from advercity.digests import compute_rounding_digest, compute_source_digest
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes
from advercity.errors import RunError, describe_cause
from advercity.run_options import CloudEncoding, DatasetOptions

CODE_PACKAGES = ("advercity", "advercity_dsl")
"""Packages whose sources make the data, whichever backend renders them."""
REMEDY = "it is the only list of written files: delete the folder, or choose another `output`"
RendererIdentity = dict[str, str | int | float | bool]
FIELD_LABELS = {
    "code_sha256": "code of advercity",
    "left_out": "sensors and agents left out",
    "backend_sha256": "code of the backend",
    "vector_instructions": "vector instructions of the processor",
    "rounding_sha256": "rounding of the processor's libraries",
}
"""Words for fields of the identity in messages."""
VERSIONED_PACKAGES = (
    "eclipse-sumo",
    "embreex",
    "imagecodecs",
    "numpy",
    "opencv-python-headless",
    "zlib-ng",
)
"""Distributions whose version may change the bytes."""


def compute_spec_digest(spec: Spec) -> str:
    """Compute the SHA-256 of a spec as JSON."""
    return hashlib.sha256(spec.model_dump_json().encode()).hexdigest()


def find_vector_instructions() -> str:
    """Find numpy's vector instructions on this processor, such as `X86_V3`.

    The last bits of its exponentials, logarithms and sines depend on them.
    """
    functions = np.lib.introspect.opt_func_info(func_name="^exp$", signature="float32")
    return next((row["current"] for row in functions.get("exp", {}).values()), "baseline")


class Identity(Model):
    """All inputs of the bytes of a scenario's data.

    Attributes:
        spec: Id of the spec.
        spec_sha256: Checksum of the spec.
        trace_sha256: Checksum of the simulated traffic.
        world_sha256: Checksum of the static scene, the bodies and the images of their models.
        renderer: Backend and its sources, profile, image scale, device.
        bodies: SHA-256 of the 3-D model of each blueprint with one.
        missing_models: Blueprints with generated bodies in place of the spec's models, and packs
            with generated surfaces in place of theirs.
        edited: Whether the spec was edited after it was compiled.
        missed_conflicts: Staged conflicts not realised as declared, and why.
        format: Layout of the files.
        min_points: LiDAR points an actor must return to an agent to be annotated by it.
        clouds: Encoding of point clouds.
        left_out: Kinds of sensors and agents that the run left out.
        vector_instructions: Instructions of the processor, by `find_vector_instructions`.
        rounding_sha256: Checksum of how NumPy, OpenBLAS and glibc round; empty in old manifests.
        code_sha256: Checksum of the sources of `CODE_PACKAGES`, which may change between versions.
        versions: Versions of advercity, `VERSIONED_PACKAGES`, and packages of the spec's sensors.
    """

    spec: str
    spec_sha256: str
    trace_sha256: str
    world_sha256: str
    renderer: RendererIdentity
    bodies: dict[str, str] = Field(default_factory=dict[str, str])
    missing_models: tuple[str, ...] = Field(default=(), exclude_if=is_empty)
    edited: bool = Field(default=False, exclude_if=is_empty)
    missed_conflicts: tuple[str, ...] = Field(default=(), exclude_if=is_empty)
    format: str
    min_points: int = 0
    clouds: CloudEncoding = "binary_compressed"
    left_out: tuple[str, ...] = Field(default=(), exclude_if=is_empty)
    vector_instructions: str
    rounding_sha256: str = ""
    code_sha256: str
    versions: dict[str, str]

    @field_validator("format")
    @classmethod
    def _check_format(cls, name: str) -> str:
        if name not in FORMATS:
            raise ValueError(f"{name!r:.60} is no layout")
        return name

    @staticmethod
    def for_spec(
        spec: Spec,
        *,
        trace_sha256: str,
        world_sha256: str,
        renderer: RendererIdentity,
        options: DatasetOptions | None = None,
        missing_models: tuple[str, ...] = (),
        edited: bool = False,
        missed_conflicts: tuple[str, ...] = (),
    ) -> "Identity":
        """Identify the data this installation makes from `spec`."""
        chosen, unrecorded = options or DatasetOptions(), spec.unrecorded
        models = {
            name: digest
            for kind, name, digest in (
                (*asset.split("/"), digest) for asset, digest in spec.assets.items()
            )
            if kind == "model" and name not in missing_models
        }
        return Identity(
            spec=spec.id,
            spec_sha256=compute_spec_digest(spec),
            trace_sha256=trace_sha256,
            world_sha256=world_sha256,
            renderer=renderer,
            bodies=models,
            missing_models=missing_models,
            edited=edited,
            missed_conflicts=missed_conflicts,
            format=chosen.format,
            min_points=chosen.min_points,
            clouds=chosen.clouds,
            left_out=(*unrecorded.sensors, *unrecorded.agents) if unrecorded else (),
            vector_instructions=find_vector_instructions(),
            rounding_sha256=compute_rounding_digest(),
            code_sha256=compute_source_digest(*CODE_PACKAGES),
            versions={"advercity": __version__}
            | {
                name: version(name)
                for name in (*VERSIONED_PACKAGES, *_list_packages_of_others(spec))
            },
        )

    @property
    def options(self) -> DatasetOptions:
        """Options for making the data."""
        return DatasetOptions(format=self.format, min_points=self.min_points, clouds=self.clouds)

    def list_differences(self, other: "Identity") -> list[str]:
        """List the differences to `other`, as `name: value here, value there`, shortened."""
        mine, others = self._flatten(), other._flatten()
        return [
            f"{key}: {mine.get(key)!s:.20}, {others.get(key)!s:.20}"
            for key in sorted(mine | others)
            if mine.get(key) != others.get(key)
        ]

    def check_same(self, other: "Identity", where: Path | str, *, remedy: str) -> None:
        """Check whether a scenario of this identity can take data of another one.

        Raises:
            RunError: They differ; the text lists the differences and a remedy.
        """
        differences = self.list_differences(other)
        if differences:
            raise RunError(
                f"{where}: was made from another spec, version or device"
                f" ({'; '.join(differences)}); {remedy}"
            )

    def _flatten(self) -> RendererIdentity:
        fields = self.model_dump(exclude={"renderer", "versions", "bodies"})
        # Which models there are follows from the spec and from which of them are missing.
        fields["missing_models"] = ", ".join(self.missing_models)
        fields["left_out"] = ", ".join(self.left_out)
        fields["missed_conflicts"] = "; ".join(self.missed_conflicts)
        flat = fields | self.renderer | self.versions
        return {FIELD_LABELS.get(key, key): value for key, value in flat.items()}


class Manifest(Model):
    """The written files of a scenario; the same data give the same text.

    Attributes:
        manifest_version: Version of these fields.
        identity: The inputs of the bytes.
        weather: The weather of frame 0 in physical quantities.
        spec: The spec of the scenario; any other file can be made from it again.
        length: Number of frames of the whole scenario.
        complete: Whether all of them are written.
        frames: Numbers of the written frames, sorted.
        files: Records by path within the scenario.
    """

    manifest_version: Literal[5] = MANIFEST_VERSION
    identity: Identity
    weather: WeatherTruth
    spec: Spec
    length: int
    complete: bool
    frames: tuple[int, ...]
    files: dict[FilePath, FileRecord]

    @staticmethod
    def from_files(
        identity: Identity, spec: Spec, *, length: int, files: Mapping[str, FileRecord]
    ) -> "Manifest":
        """Build the manifest of these files."""
        frames = sorted({file.frame for file in files.values() if file.frame is not None})
        return Manifest(
            identity=identity,
            weather=WeatherTruth.from_weather(spec.weather),
            spec=spec,
            length=length,
            complete=len(frames) == length,
            frames=tuple(frames),
            # Sorted: the order in which processes finish frames must not show.
            files={path: files[path] for path in sorted(files)},
        )

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        for path, record in self.files.items():
            if record.frame is not None and record.frame >= self.length:
                raise ValueError(f"{path} is of frame {record.frame} of {self.length}")
        return self

    @property
    def frame_file_names(self) -> FrameFileNames:
        """The names of the files of its frames."""
        return FrameFileNames(self.spec, self.identity.format, self.length)

    @property
    def size_bytes(self) -> int:
        """Size of all files without the manifest."""
        return sum(record.size for record in self.files.values())

    def to_json(self) -> str:
        """Format it as JSON: files sorted, without times and machine paths, with a newline."""
        return self.model_dump_json(indent=1) + "\n"

    @staticmethod
    def load(scenario: Path, *, moved: bool = True) -> "Manifest":
        """Load the manifest of a scenario, with the journals of an interrupted run.

        Args:
            scenario: Folder of the scenario.
            moved: Only files already in place; else also files possibly still to be moved.

        Raises:
            InputError: The folder does not exist, or its manifest is missing or no JSON.
            RunError: The manifest cannot be read, or is of another version.
        """
        check_is_readable(scenario)
        path = scenario / MANIFEST_FILE
        try:
            text = read_bytes(path, max_bytes=MAX_JSON_BYTES)
        except (FileNotFoundError, NotADirectoryError) as error:
            raise not_a_scenario_error(scenario) from error
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
        manifest = Manifest.parse(text, where=str(path))
        journaled = {
            path: record
            for path, record in read_journals(scenario, moved=moved).items()
            if record.frame is None or record.frame < manifest.length
        }
        if not journaled:
            return manifest
        return Manifest.from_files(
            manifest.identity,
            manifest.spec,
            length=manifest.length,
            files=manifest.files | journaled,
        )

    @staticmethod
    def parse(text: bytes, *, where: str) -> "Manifest":
        """Parse the text of `to_json`.

        Raises:
            InputError: It is no JSON; the text names line and column.
            RunError: It is no manifest of this version.
        """
        document = parse_json(text, Path(where), hint=REMEDY)
        try:
            return Manifest.model_validate(document)
        except ValidationError as error:
            message = f"not a manifest of this version: {_format_first_error(error)}"
            raise RunError(f"{where}: {message}; {REMEDY}") from error


def list_kinds_of_others(spec: Spec) -> set[str]:
    """List the third-party kinds of sensors in a spec."""
    others = load_sensor_kinds().found.keys() - CORE_KINDS.keys()
    return {
        kind
        for kind in others
        if any(agent.sensors.list_sensors(kind) for agent in spec.recorded_agents)
    }


def _list_packages_of_others(spec: Spec) -> set[str]:
    """List the third-party distributions of a spec's sensors and parts of the weather."""
    sensors, parts = load_sensor_kinds().distributions, load_weather_parts()
    states = (spec.weather, *spec.weather.keyframes)
    return {sensors[kind] for kind in list_kinds_of_others(spec)} | {
        parts.distributions[name]
        for name in parts.found.keys() - CORE_PARTS.keys()
        if any(name in state.model_dump(include={name}) for state in states)
    }


def _format_first_error(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(map(str, first["loc"]))
    return f"{where}: {first['msg']}" if where else first["msg"]
