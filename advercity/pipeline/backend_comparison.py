"""Renders one camera with several backends, and compares luminance, classes and actors."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.geometry.arrays import Float32Array, Uint8Array
from advercity.material_maps import LINEAR_FROM_SRGB
from advercity.media import check_image_file, draw_label_bar, write_image
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.pipeline.preparation import PreparedScenario, load_or_simulate_traffic
from advercity.pipeline.sensing import find_agent_with_camera, open_sensors
from advercity.pipeline.spec_models import check_models, find_missing_models
from advercity.rendering.backend import RENDER_PROFILES, CameraCapture, load_backend
from advercity.semantics import Semantic

MIDDLE_GREY = 0.18
"""Linear value of the geometric mean of the last backend's picture."""
MAX_DIFFERENCE_STOPS = 1.0
"""Difference of luminance in full colour, as a power of two."""
LEAST_CD_M2 = 1e-4
LEAST_PIXELS = 50
"""Classes with fewer pixels are left out: their means say little."""


@dataclass(frozen=True)
class ClassLight:
    """Mean luminance of a semantic class where all backends show it.

    Attributes:
        semantic: Name of the class; `all` for the whole image.
        fraction: Of the image.
        cd_m2: By backend, in the order asked for.
        ratios: Of each to the last.
    """

    semantic: str
    fraction: float
    cd_m2: tuple[float, ...]
    ratios: tuple[float, ...]


@dataclass(frozen=True)
class BackendComparison:
    """Differences between the images of backends.

    Attributes:
        backends: Their names.
        classes: Light by class, the whole image first.
        semantic_agreement: Fraction of pixels of one semantic class, each against the last.
        instance_agreement: Fraction of pixels of one actor, each against the last.
    """

    backends: tuple[str, ...]
    classes: tuple[ClassLight, ...]
    semantic_agreement: tuple[float, ...]
    instance_agreement: tuple[float, ...]

    def to_rows(self) -> list[dict[str, str]]:
        """Return the rows of a table, by its heads."""
        return [
            {
                "class": item.semantic,
                "area": f"{item.fraction:.1%}",
                **{
                    f"{name}, cd/m²": f"{mean:.4g}"
                    for name, mean in zip(self.backends, item.cd_m2, strict=True)
                },
                **{
                    f"{name} / {self.backends[-1]}": f"{ratio:.3f}"
                    for name, ratio in zip(self.backends[:-1], item.ratios[:-1], strict=True)
                },
            }
            for item in self.classes
        ]


def compare_backends(
    spec: Spec,
    backends: Sequence[str],
    output: Path,
    *,
    agent: str | None = None,
    camera: int = 0,
    frame: int | None = None,
    profile: str = "preview",
    width_px: int = 480,
    allow_missing_models: bool = False,
) -> BackendComparison:
    """Render a camera with each backend; write their pictures and maps of their differences.

    All pictures have one exposure. A map shows where a backend is brighter than the last (red) or
    darker (blue), in full colour by a factor of two.

    Args:
        spec: The scenario.
        backends: At least two names; the last is the reference.
        output: Image file to write.
        agent: Agent with the camera; None is the ego.
        camera: Index of the camera, from 0.
        frame: Recorded frame; None is the middle one.
        profile: `preview` or `full`; `width_px` sets the image size.
        width_px: Width of each image.
        allow_missing_models: Generate bodies in place of missing models.

    Raises:
        InputError: There is no such backend, agent, camera, frame or profile, or models are
            missing.
        BackendError: A backend cannot render the profile on this machine.
    """
    if len(backends) < 2:
        raise InputError("`backends`: name at least two, such as sapien,mitsuba")
    if profile not in RENDER_PROFILES:
        raise InputError(f"`profile` {profile}: no such profile; preview or full")
    check_image_file(output)
    check_models([spec], allow_missing=allow_missing_models)
    carrier = find_agent_with_camera(spec, agent, camera)
    traffic = load_or_simulate_traffic(spec)
    index = len(traffic.trace) // 2 if frame is None else frame
    if index >= len(traffic.trace):
        raise InputError(f"{spec.id} has frames 0 to {len(traffic.trace) - 1}, not {index}")
    scale = width_px / carrier.sensors.cameras[camera].model.width_px
    captures: list[CameraCapture] = []
    for name in backends:
        prepared = PreparedScenario(
            spec,
            traffic,
            load_backend(name),
            RENDER_PROFILES[profile].with_scale(scale),
            frames=range(index, index + 1),
            missing_models=find_missing_models(spec),
        )
        with open_sensors(prepared) as sensors:
            captures.append(sensors.capture_camera(carrier, camera, index))
    write_image(_draw_comparison(backends, captures), output)
    return _measure(backends, captures)


def _measure(backends: Sequence[str], captures: Sequence[CameraCapture]) -> BackendComparison:
    luminances = [capture.radiance @ LUMINANCE_WEIGHTS for capture in captures]
    last = captures[-1]
    same = np.all([one.semantic == last.semantic for one in captures], axis=0)
    areas = {"all": np.ones_like(same)} | {
        semantic.name.lower(): same & (last.semantic == semantic) for semantic in Semantic
    }
    return BackendComparison(
        tuple(backends),
        tuple(
            _measure_class(name, where, luminances)
            for name, where in areas.items()
            if np.count_nonzero(where) >= LEAST_PIXELS
        ),
        tuple(float((one.semantic == last.semantic).mean()) for one in captures[:-1]),
        tuple(float((one.instance == last.instance).mean()) for one in captures[:-1]),
    )


def _measure_class(
    name: str, where: NDArray[np.bool_], luminances: Sequence[Float32Array]
) -> ClassLight:
    means = [float(luminance[where].mean()) for luminance in luminances]
    ratios = tuple(mean / max(means[-1], LEAST_CD_M2) for mean in means)
    return ClassLight(name, float(where.mean()), tuple(means), ratios)


def _draw_comparison(backends: Sequence[str], captures: Sequence[CameraCapture]) -> Uint8Array:
    """Draw a row of pictures (h, w, 3), BGR, above the maps of their differences."""
    light = captures[-1].radiance @ LUMINANCE_WEIGHTS
    exposure = MIDDLE_GREY / float(np.exp(np.log(np.maximum(light, LEAST_CD_M2)).mean()))
    columns: list[Uint8Array] = []
    for name, capture in zip(backends, captures, strict=True):
        parts = [_expose(capture.radiance, exposure)]
        title = name
        if capture is not captures[-1]:
            parts.append(_draw_difference(capture.radiance @ LUMINANCE_WEIGHTS, light))
            title = f"{name}; below, brighter (red) or darker than {backends[-1]}"
        else:
            parts.append(np.zeros_like(parts[0]))
        columns.append(np.vstack([draw_label_bar(title, capture.radiance.shape[1]), *parts]))
    return np.hstack(columns)


def _expose(radiance: Float32Array, exposure: float) -> Uint8Array:
    steps = (LINEAR_FROM_SRGB[1:] + LINEAR_FROM_SRGB[:-1]) / 2.0
    return np.searchsorted(steps, radiance[..., ::-1] * exposure).astype(np.uint8)


def _draw_difference(luminance: Float32Array, reference: Float32Array) -> Uint8Array:
    stops = np.log2(np.maximum(luminance, LEAST_CD_M2) / np.maximum(reference, LEAST_CD_M2))
    # Noise of single pixels would hide the differences.
    smooth = cv2.GaussianBlur(stops.astype(np.float32), (0, 0), 1.5)
    strength = np.clip(smooth / MAX_DIFFERENCE_STOPS, -1.0, 1.0)[..., None]
    red, blue = np.array([60, 60, 220.0]), np.array([220, 110, 30.0])
    colour = np.where(strength > 0.0, red, blue)
    return (255.0 + (colour - 255.0) * np.abs(strength)).astype(np.uint8)
