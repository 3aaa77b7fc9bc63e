"""What a scenario's folder holds, with checksums, and what decides it."""

import hashlib
import math
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from advercity_dsl import Model, Spec, Weather
from pydantic import Field, ValidationError

from advercity import __version__
from advercity.dataset.partial_files import FileRecord, read_journals
from advercity.dataset.scenario_folders import (
    MANIFEST_FILE,
    MANIFEST_VERSION,
    not_a_scenario_error,
)
from advercity.digests import compute_source_digest
from advercity.errors import RunError
from advercity.physics.extinction import compute_extinction

CODE_PACKAGES = ("advercity", "advercity_dsl")
"""Packages that make the data, whatever renders them."""
RendererIdentity = dict[str, str | int | float | bool]
FIELD_LABELS = {"code_sha256": "code of advercity", "backend_sha256": "code of the backend"}
"""What is told instead of fields."""
VERSIONED_PACKAGES = ("eclipse-sumo", "embreex", "numpy", "opencv-python-headless", "zlib-ng")
"""Whose versions may change what is written."""


def compute_spec_digest(spec: Spec) -> str:
    """SHA-256 of a spec as JSON."""
    return hashlib.sha256(spec.model_dump_json().encode()).hexdigest()


class Identity(Model):
    """What decides every byte of a scenario's data."""

    spec: str
    spec_sha256: str
    trace_sha256: str
    renderer: RendererIdentity
    """Backend and its sources, profile, image scale, device: whatever changes pictures."""
    bodies: dict[str, str] = Field(default_factory=dict[str, str])
    """SHA-256 of the model that stands for each blueprint; the others were shaped here."""
    format: str
    code_sha256: str
    """Of the sources of `CODE`: a changed program that kept its version number is told by it."""
    versions: dict[str, str]
    """Of advercity and of `PACKAGES`."""

    @staticmethod
    def for_spec(
        spec: Spec,
        *,
        trace_sha256: str,
        renderer: RendererIdentity,
        bodies: Mapping[str, str] | None = None,
        format: str = "opv2v",
    ) -> "Identity":
        """Identity of the data of `spec`."""
        return Identity(
            spec=spec.id,
            spec_sha256=compute_spec_digest(spec),
            trace_sha256=trace_sha256,
            renderer=renderer,
            bodies=dict(bodies or {}),
            format=format,
            code_sha256=compute_source_digest(*CODE_PACKAGES),
            versions={"advercity": __version__}
            | {name: version(name) for name in VERSIONED_PACKAGES},
        )

    def find_differences(self, other: "Identity") -> list[str]:
        """What is not the same in `other`, as `name: value here, value there`, both shortened."""
        mine, others = self._flatten(), other._flatten()
        return [
            f"{key}: {mine.get(key)!s:.20}, {others.get(key)!s:.20}"
            for key in sorted(mine | others)
            if mine.get(key) != others.get(key)
        ]

    def _flatten(self) -> RendererIdentity:
        alone = self.model_dump(exclude={"renderer", "versions", "bodies"})
        bodies = {f"body of {name}": digest for name, digest in self.bodies.items()}
        flat = alone | self.renderer | self.versions | bodies
        return {FIELD_LABELS.get(key, key): value for key, value in flat.items()}


class WeatherTruth(Model):
    """The weather as it really is; the same in every frame of a scenario."""

    id: str
    time: str
    mor_m: float | None
    """Meteorological optical range of all that is in the air; None if nothing is."""
    rain_mm_h: float
    snow_mm_h: float
    wind_m_s: float
    wind_from_deg: float
    sun_elevation_deg: float
    sun_azimuth_deg: float
    wetness: float
    puddle_coverage: float
    temperature_c: float

    @staticmethod
    def from_weather(weather: Weather) -> "WeatherTruth":
        """Of an authored weather."""
        mor_m = compute_extinction(weather).mor_m
        return WeatherTruth(
            id=weather.id,
            time=weather.time,
            mor_m=round(mor_m, 6) if math.isfinite(mor_m) else None,
            rain_mm_h=weather.rain.rate_mm_h,
            snow_mm_h=weather.snow.rate_mm_h,
            wind_m_s=weather.wind.speed_m_s,
            wind_from_deg=weather.wind.from_deg,
            sun_elevation_deg=weather.sun.elevation_deg,
            sun_azimuth_deg=weather.sun.azimuth_deg,
            wetness=weather.surface.wetness,
            puddle_coverage=weather.surface.puddle_coverage,
            temperature_c=weather.temperature_c,
        )


class Manifest(Model):
    """What has been written of a scenario; the same data give the same text."""

    manifest_version: Literal[3] = MANIFEST_VERSION
    identity: Identity
    weather: WeatherTruth
    spec: Spec
    """What the data are made from, so that any other file can be made again."""
    length: int
    """Frames of the whole scenario."""
    complete: bool
    """Whether all of them are done."""
    frames: tuple[int, ...]
    """Those that are done."""
    files: dict[str, FileRecord]
    """By path within the scenario."""

    @staticmethod
    def from_files(
        identity: Identity, spec: Spec, *, length: int, files: Mapping[str, FileRecord]
    ) -> "Manifest":
        """Manifest of these files."""
        frames = sorted({file.frame for file in files.values() if file.frame is not None})
        return Manifest(
            identity=identity,
            weather=WeatherTruth.from_weather(spec.weather),
            spec=spec,
            length=length,
            complete=len(frames) == length,
            frames=tuple(frames),
            files={path: files[path] for path in sorted(files)},
        )

    @property
    def size_bytes(self) -> int:
        """Of all files but this."""
        return sum(record.size for record in self.files.values())

    def to_json(self) -> str:
        """Sorted, without times and places, ending in a newline."""
        return self.model_dump_json(indent=1) + "\n"

    @staticmethod
    def load(scenario: Path) -> "Manifest":
        """What is done of a scenario: its manifest, and the journal of a run that was cut short.

        Raises:
            InputError: There is no such folder, or no manifest in it.
            RunError: It cannot be read.
        """
        path = scenario / MANIFEST_FILE
        try:
            text = path.read_bytes()
        except (FileNotFoundError, NotADirectoryError) as error:
            raise not_a_scenario_error(scenario) from error
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {error.strerror}") from error
        written, noted = Manifest.parse(text, where=str(path)), read_journals(scenario)
        if not noted:
            return written
        return Manifest.from_files(
            written.identity, written.spec, length=written.length, files=written.files | noted
        )

    @staticmethod
    def parse(text: bytes, *, where: str) -> "Manifest":
        """Read what `to_json` gave; RunError if it is something else."""
        try:
            return Manifest.model_validate_json(text)
        except ValidationError as error:
            remedy = "`advercity run --fresh` makes the scenario anew"
            raise RunError(f"{where}: {_format_first_error(error)}; {remedy}") from error


def _format_first_error(error: ValidationError) -> str:
    """Where the first thing that is wrong stands, and what it is."""
    first = error.errors(include_url=False)[0]
    if first["type"] == "json_invalid":
        return "is damaged or cut off"
    where = ".".join(map(str, first["loc"]))
    what = f"{where}: {first['msg']}" if where else first["msg"]
    return f"not a manifest of this version: {what}"
