"""Compare the LiDAR models that ship with published figures, in `lidar_calibration.md`.

    python docs/make_lidar_calibration.py

The figures and their sources are in `lidar_measurements.yaml`. Those to `fit` have set parameters
of the models' files; all others are predicted.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist

import numpy as np
import yaml
from advercity_dsl import Lidar, LidarModel
from pydantic import BaseModel, ConfigDict, JsonValue

from advercity.compiler import find_shipped_library, load_library
from advercity.physics.extinction import (
    AirExtinction,
    Extinction,
    extinction_from_mor,
    rain_extinction,
    snow_extinction,
)
from advercity.physics.precipitation import rain_size_distribution, snow_size_distribution
from advercity.randomness import create_generator
from advercity.sensors.lidar.beams import BeamShape
from advercity.sensors.lidar.forward_scattering import Diffraction
from advercity.sensors.lidar.received_power import (
    SIGNAL_TO_NOISE,
    Receiver,
    daylight_noise_factor,
    detection_margin_sigma,
    range_standard_deviation_m,
)
from advercity.sensors.lidar.volume_scattering import (
    LOG_POWER_DEVIATION,
    ParticleTable,
    SoftTarget,
)

FOLDER = Path(__file__).parent
DROPLET_M = 16e-6
"""Diameter of the droplets of dense fog."""
SNOW_DENSITY_G_CM3 = 0.1
CLEAR_PER_M = extinction_from_mor(20_000)
MAX_RANGE_M = 500.0


class Measurement(BaseModel):
    """A published figure, as `lidar_measurements.yaml` has it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    figure: dict[str, JsonValue]
    published: float
    at_most: bool = False
    at_least: bool = False
    unit: str
    source: str
    read: bool
    use: str
    sets: str = ""
    within: float


@dataclass(frozen=True)
class Comparison:
    """A published figure and the model's."""

    measurement: Measurement
    model: float

    @property
    def fits(self) -> bool:
        """Whether they agree within the measurement's limit."""
        measured = self.measurement
        ratio, limit = self.model / measured.published, measured.within
        is_low_enough = measured.at_least or ratio <= 1 + limit
        return is_low_enough and (measured.at_most or ratio >= 1 - limit)


def compare_all() -> list[Comparison]:
    """Compute the models' figure for every measurement."""
    items = yaml.safe_load((FOLDER / "lidar_measurements.yaml").read_text(encoding="utf-8"))
    library = load_library(find_shipped_library())
    lidars = {name: item.lidar for name, item in library.get_declarations(LidarModel).items()}
    return [_compare(Measurement.model_validate(item), lidars) for item in items]


def _compare(measurement: Measurement, lidars: dict[str, Lidar]) -> Comparison:
    arguments = dict(measurement.figure)
    figure = FIGURES[str(arguments.pop("kind"))]
    if "model" in arguments:
        return Comparison(measurement, figure(lidars[str(arguments.pop("model"))], **arguments))
    return Comparison(measurement, figure(**arguments))


def _find_range_m(
    lidar: Lidar,
    *,
    reflectance: float,
    fog_mor_m: float = math.inf,
    illuminance_lx: float = 0.0,
    probability: float = 0.5,
) -> float:
    receiver, fog_per_m = Receiver.from_lidar(lidar), extinction_from_mor(fog_mor_m)
    kept = Diffraction(fog_per_m, DROPLET_M).kept_extinction_per_m(receiver.field_of_view_rad)
    ranges = np.arange(1.0, MAX_RANGE_M, 0.1)
    power = receiver.received_power(
        ranges, np.full_like(ranges, reflectance), CLEAR_PER_M + fog_per_m - kept
    )
    margin = detection_margin_sigma(power / daylight_noise_factor(illuminance_lx))
    return float(ranges[margin >= NormalDist().inv_cdf(probability)].max())


def _compute_range_noise_m(lidar: Lidar, *, snr: float) -> float:
    return float(range_standard_deviation_m(lidar, np.array([snr / SIGNAL_TO_NOISE]))[0])


def _find_depth_of_scattered_light(*, field_of_view_mrad: float) -> float:
    """Find the optical depth, one way, at which scattered light in view equals the beam's own."""
    kept = Diffraction(1.0, DROPLET_M).kept_extinction_per_m(field_of_view_mrad * 1e-3)
    return math.log(2.0) / kept


def _compute_visibility_gain(*, field_of_view_mrad: float) -> float:
    kept = Diffraction(1.0, DROPLET_M).kept_extinction_per_m(field_of_view_mrad * 1e-3)
    return 1.0 / (1.0 - kept) - 1.0


def _compute_rain_attenuation(*, rate_mm_h: float, field_of_view_mrad: float) -> float:
    per_m = rain_extinction(rate_mm_h)
    drops = Diffraction.from_sizes(rain_size_distribution(rate_mm_h), per_m)
    seen = per_m - drops.kept_extinction_per_m(field_of_view_mrad * 1e-3)
    return 10.0 * math.log10(math.e) * seen * 1000.0


def _compute_snow_fraction_beyond(lidar: Lidar, *, rate_mm_h: float, range_m: float) -> float:
    sizes = snow_size_distribution(rate_mm_h, SNOW_DENSITY_G_CM3)
    per_m = snow_extinction(rate_mm_h, density_g_cm3=SNOW_DENSITY_G_CM3)
    table = ParticleTable.build(
        sizes, per_m, Receiver.from_lidar(lidar), BeamShape.from_lidar(lidar)
    )
    _, ranges, power = table.sample(400_000, create_generator("calibration"))
    detected = ranges[power >= 1.0]
    return float((detected > range_m).mean())


def _compute_fog_echo_fraction(lidar: Lidar, *, fog_mor_m: float) -> float:
    """Compute the fraction of beams into fog that return from it, by the noise of the receiver."""
    per_m = extinction_from_mor(fog_mor_m)
    fog = AirExtinction(fog=Extinction(per_m, per_m))
    soft = SoftTarget.from_extinction(fog, per_m, Receiver.from_lidar(lidar))
    assert soft is not None
    levels = np.array([NormalDist().inv_cdf((step + 0.5) / 1000) for step in range(1000)])
    power = soft.peak_power * np.exp(LOG_POWER_DEVIATION * levels)
    return float(np.mean([NormalDist().cdf(x) for x in detection_margin_sigma(power)]))


FIGURES: dict[str, Callable[..., float]] = {
    "range": _find_range_m,
    "range_noise": _compute_range_noise_m,
    "scattered_outweighs": _find_depth_of_scattered_light,
    "visibility_gain": _compute_visibility_gain,
    "rain_attenuation": _compute_rain_attenuation,
    "snow_beyond": _compute_snow_fraction_beyond,
    "fog_echoes": _compute_fog_echo_fraction,
}


def format_page(comparisons: list[Comparison]) -> str:
    """Format the page in Markdown."""
    lines: list[str] = []
    for item in comparisons:
        measured = item.measurement
        bound = "at most " if measured.at_most else "at least " if measured.at_least else ""
        unit = f" {measured.unit}".rstrip()
        use = f"fit: {measured.sets}" if measured.sets else measured.use
        mark = "" if measured.read else " `*`"
        lines.append(
            f"| {measured.name} | {bound}{measured.published:g}{unit} | {item.model:.3g}{unit}"
            f" | {use} | {'yes' if item.fits else '**no**'} | {measured.source}{mark} |"
        )
    tested = [item for item in comparisons if item.measurement.use == "test"]
    hits = sum(item.fits for item in tested)
    result = f"Of {len(tested)} predictions, {hits} fit."
    return "\n".join([HEADING, *lines, "", result, "", REMARKS])


HEADING = """# LiDAR models against published figures

Made by `python docs/make_lidar_calibration.py` from `docs/lidar_measurements.yaml`. Rows to *fit*
have set a parameter of the models' files, `library/nhtsa/lidars`; rows to *test* are predicted.
`*` marks figures that are as commonly quoted, not read in the source.

| figure | published | model | use | fits | source |
|---|---|---|---|---|---|"""
REMARKS = """What does not fit, and why:

- The HDL-64E sees 80 % targets farther by the law than its manual says, which ends at the sensor's
  maximum range; `range_m` cuts the points there.
- The range noise of the OS1 falls with a power of the signal-to-noise ratio between 0.5 and 1, the
  model's with 1.
- The lidar in dense fog saw more light that is scattered forward than a field of view of 5 mrad
  keeps. None is published for either experiment in fog; 5 mrad is an assumption.
- Links through rain receive some of the light that drops diffract. An open receiver would lose
  half of the model's figure.

Not in this table: counts of fog, rain and snow points by named sensors. Those that are published
depend on settings of the firmware and on targets that are not.
"""


def main() -> None:
    """Write the page."""
    page = format_page(compare_all())
    (FOLDER / "lidar_calibration.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
