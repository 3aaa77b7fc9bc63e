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
from advercity_dsl.weather_components import Fog, Rain, Snow
from pydantic import BaseModel, ConfigDict, JsonValue

from advercity.compiler import find_shipped_library, load_library
from advercity.materials import MATERIALS
from advercity.physics.extinction import (
    AirExtinction,
    extinction_from_mor,
)
from advercity.physics.weather_parts.fog import find_droplets
from advercity.physics.weather_parts.rain import find_drops
from advercity.physics.weather_parts.snow import find_flakes
from advercity.randomness import create_generator
from advercity.sensors.lidar.beams import BeamShape
from advercity.sensors.lidar.forward_scattering import Diffraction
from advercity.sensors.lidar.received_power import (
    SIGNAL_TO_NOISE,
    Receiver,
    compute_rough_lobe,
    daylight_noise_factor,
    detection_margin_sigma,
    range_standard_deviation_m,
    wet_reflectance_ratio,
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
ASPHALT = MATERIALS["asphalt"]
MAX_RANGE_M = 500.0
THIN_FOG_M = 300.0


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

    @property
    def is_bound(self) -> bool:
        """Whether it bounds the model's figure on one side only."""
        return self.at_most or self.at_least


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
    lidars = load_lidars()
    return [_compare(Measurement.model_validate(item), lidars) for item in items]


def load_lidars() -> dict[str, Lidar]:
    """Load the models that ship, by their names."""
    models = load_library(find_shipped_library()).get_declarations(LidarModel)
    return {name: model.lidar for name, model in models.items()}


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
    rain = find_drops(Rain(rate_mm_h=rate_mm_h))
    assert rain is not None
    drops = Diffraction.from_precipitation(rain)
    seen = rain.extinction_per_m - drops.kept_extinction_per_m(field_of_view_mrad * 1e-3)
    return 10.0 * math.log10(math.e) * seen * 1000.0


def _compute_snow_fraction_beyond(lidar: Lidar, *, rate_mm_h: float, range_m: float) -> float:
    snow = find_flakes(Snow(rate_mm_h=rate_mm_h, density_g_cm3=SNOW_DENSITY_G_CM3))
    assert snow is not None
    table = ParticleTable.build(
        snow, snow.extinction_per_m, Receiver.from_lidar(lidar), BeamShape.from_lidar(lidar)
    )
    _, ranges, power = table.sample(400_000, create_generator("calibration"))
    detected = ranges[power >= 1.0]
    return float((detected > range_m).mean())


def _compute_fog_echo_fraction(lidar: Lidar, *, fog_mor_m: float) -> float:
    """Compute the fraction of beams into fog that return from it, by the noise of the receiver."""
    fog = find_droplets(Fog(mor_m=fog_mor_m))
    assert fog is not None
    per_m, receiver = fog.extinction.at_905nm, Receiver.from_lidar(lidar)
    soft = SoftTarget.from_extinction(AirExtinction((fog,)), per_m, receiver)
    assert soft is not None
    levels = np.array([NormalDist().inv_cdf((step + 0.5) / 1000) for step in range(1000)])
    power = lidar.soft_gain * soft.peak_power * np.exp(LOG_POWER_DEVIATION * levels)
    return float(np.mean([NormalDist().cdf(x) for x in detection_margin_sigma(power)]))


def _compute_dry_return(height_m: float, distance_m: float) -> float:
    """Compute the return of a dry road, over a white target that faces the sensor."""
    cosine = height_m / math.hypot(height_m, distance_m)
    lobe = compute_rough_lobe(ASPHALT.facet_slope_deg)
    return ASPHALT.reflectance_905nm * (cosine + lobe * (1.0 - cosine**2))


def _compute_road_level(lidar: Lidar, *, height_m: float, distance_m: float) -> float:
    """Compute the level that a sensor at a height above a dry road reports of it."""
    assert lidar.receiver.white_level is not None
    return lidar.receiver.white_level * _compute_dry_return(height_m, distance_m)


def _compute_road_fill(
    lidar: Lidar, *, height_m: float, distance_m: float, illuminance_lx: float
) -> float:
    """Compute the fraction of beams onto a dry road that return, in daylight."""
    range_m = np.array([math.hypot(height_m, distance_m)])
    returned = np.array([_compute_dry_return(height_m, distance_m)])
    power = Receiver.from_lidar(lidar).received_power(range_m, returned, CLEAR_PER_M)
    margin = detection_margin_sigma(power / daylight_noise_factor(illuminance_lx))
    return NormalDist().cdf(margin[0])


def _find_wet_road_m(lidar: Lidar, *, height_m: float) -> float:
    """Find the distance at which half of the beams onto a soaked road return."""
    distance_m = np.arange(2.0, 60.0, 0.1)
    cosine = height_m / np.hypot(height_m, distance_m)
    dry, lobe = ASPHALT.reflectance_905nm, compute_rough_lobe(ASPHALT.facet_slope_deg)
    wet = dry * cosine * wet_reflectance_ratio(np.full_like(cosine, dry), cosine, lobe)
    power = Receiver.from_lidar(lidar).received_power(
        np.hypot(height_m, distance_m), wet, CLEAR_PER_M
    )
    return float(distance_m[power >= 1.0].max())


FIGURES: dict[str, Callable[..., float]] = {
    "range": _find_range_m,
    "range_noise": _compute_range_noise_m,
    "scattered_outweighs": _find_depth_of_scattered_light,
    "visibility_gain": _compute_visibility_gain,
    "rain_attenuation": _compute_rain_attenuation,
    "snow_beyond": _compute_snow_fraction_beyond,
    "fog_echoes": _compute_fog_echo_fraction,
    "road_level": _compute_road_level,
    "road_fill": _compute_road_fill,
    "wet_road": _find_wet_road_m,
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
    fitted, tested, bounds = split_by_use(comparisons)
    result = (
        f"Of {len(tested)} predictions of a number, {sum(item.fits for item in tested)} fit. Of"
        f" {len(bounds)} predictions of a bound, {sum(item.fits for item in bounds)} are met."
        f" {len(fitted)} figures have set a parameter each, and so test nothing."
        f" {sum(not item.measurement.read for item in comparisons)} of all {len(comparisons)} are"
        " as commonly quoted, or aims."
    )
    echoes = ", ".join(
        f"`{name}` {_compute_fog_echo_fraction(lidar, fog_mor_m=63):.2g}"
        for name, lidar in (load_lidars() | {"default": Lidar()}).items()
    )
    remarks = REMARKS.format(
        echoes=echoes, thin=_compute_fog_echo_fraction(Lidar(), fog_mor_m=THIN_FOG_M)
    )
    return "\n".join([HEADING, *lines, "", result, "", remarks])


def split_by_use(
    comparisons: list[Comparison],
) -> tuple[list[Comparison], list[Comparison], list[Comparison]]:
    """Split comparisons into fits, predictions of a number, and predictions of a bound."""
    tested = [item for item in comparisons if item.measurement.use == "test"]
    return (
        [item for item in comparisons if item.measurement.use == "fit"],
        [item for item in tested if not item.measurement.is_bound],
        [item for item in tested if item.measurement.is_bound],
    )


HEADING = """# LiDAR models against published figures

Made by `python docs/make_lidar_calibration.py` from `docs/lidar_measurements.yaml`. Rows to *fit*
have set a parameter of the models' files, `library/nhtsa/lidars`; rows to *test* are predicted.
`*` marks figures that are as commonly quoted, not read in the source, and aims.

| figure | published | model | use | fits | source |
|---|---|---|---|---|---|"""
REMARKS = """What does not fit, and why:

- The HDL-64E sees targets in the fog chamber farther than 25 m: no one sensitivity gives both that
  and full rings on KITTI's road.
- The range noise of the OS1 falls with a power of the signal-to-noise ratio between 0.5 and 1, the
  model's with 1.
- The lidar in dense fog saw more light that is scattered forward than a field of view of 5 mrad
  keeps. None is published for either experiment in fog; 5 mrad is an assumption.
- Links through rain receive some of the light that drops diffract. An open receiver would lose
  half of the model's figure.
- The road of the scan of nuScenes is darker from 12 m on; scans of KITTI are brighter there.

The HDL-64E's manual says 50 m "for pavement". The model takes it for pavement as it lies, which is
detected with a probability of 0.9 in full sun; a panel of 10 % that faces the sensor is so at 59 m.

Echoes of fog differ most from sensor to sensor, and least is known of them. Fractions of beams into
fog of 63 m that return by its droplets:
{echoes}.
Only the HDL-64E's is measured. Scans of an HDL-32E in thin fog (RADIATE, `fog_6_0`, visibility not
stated) have returns from 1 to 12 m in one of 10,000 beams to the sky, as the model's have; of
the default's beams {thin:.0%} would return in fog of 300 m. Yu, Zhang, Xia and Wang (Laser &
Optoelectronics Progress 62, 0237014, 2025) count the points of an HDL-32E by distance in fog of 50,
80 and 100 m. Their table could not be read, and no other scans in fog of a measured visibility were
found, so `soft_gain` of `hdl_32e` and `vls_128` is an aim.

Set by judgement, without a figure: the HDL-32E's 80 m for 10 %, the HDL-64E's full sun,
`near_field_m` of the default and of `vls_128`, reflectances of
drops, flakes and stones, fields of view, stray light, and slopes of facets of all but asphalt.

Not in this table: counts of rain and snow points by named sensors. Those that are published
depend on settings of the firmware and on targets that are not.
"""


def main() -> None:
    """Write the page."""
    page = format_page(compare_all())
    (FOLDER / "lidar_calibration.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
