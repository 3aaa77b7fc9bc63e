"""Inertial measurement units: errors of their instruments, and grades of data sheets."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import CompactModel, is_none
from advercity_dsl.sampling import Sampled
from advercity_dsl.units import Celsius, Degrees, Fraction, Number, Seconds

Micro = Annotated[Number, Field(ge=0, le=1e6)]
Ppm = Annotated[Number, Field(ge=0, le=100_000)]
Milliradians = Annotated[Number, Field(ge=0, le=200)]
DegreesPerHour = Annotated[Number, Field(ge=0, le=100_000)]


class AccelerometerErrors(CompactModel):
    """Errors of three accelerometers, each axis drawn by itself with these standard deviations.

    `ug` is a millionth of standard gravity.
    """

    noise_m_s_rth: Annotated[Number, Field(ge=0, le=10)] = 0
    """White noise as velocity random walk, m/s per square root of an hour."""
    bias_instability_ug: Micro = 0
    """Drift of the bias: the floor of the Allan deviation."""
    bias_walk_ug_rth: Micro = 0
    """Random walk of the bias, per square root of an hour."""
    turn_on_bias_ug: Micro = 0
    """Bias, redrawn at every start."""
    bias_ug_per_c: Micro = 0
    """Bias per degree from the temperature of calibration."""
    scale_ppm: Ppm = 0
    """Error of scale."""
    scale_ppm_per_c: Ppm = 0
    """Error of scale per degree from the temperature of calibration."""
    misalignment_mrad: Milliradians = 0
    """Angle of each axis towards each of the others."""
    rectification_ug_g2: Micro = 0
    """Bias per squared acceleration, as vibration adds it."""


class GyroscopeErrors(CompactModel):
    """Errors of three gyroscopes, each axis drawn by itself with these standard deviations."""

    noise_deg_rth: Annotated[Number, Field(ge=0, le=100)] = 0
    """White noise as angle random walk, degrees per square root of an hour."""
    bias_instability_deg_h: DegreesPerHour = 0
    """Drift of the bias: the floor of the Allan deviation."""
    bias_walk_deg_h_rth: DegreesPerHour = 0
    """Random walk of the bias, per square root of an hour."""
    turn_on_bias_deg_h: DegreesPerHour = 0
    """Bias, redrawn at every start."""
    bias_deg_h_per_c: DegreesPerHour = 0
    """Bias per degree from the temperature of calibration."""
    scale_ppm: Ppm = 0
    """Error of scale."""
    scale_ppm_per_c: Ppm = 0
    """Error of scale per degree from the temperature of calibration."""
    misalignment_mrad: Milliradians = 0
    """Angle of each axis towards each of the others."""
    g_sensitivity_deg_h_g: DegreesPerHour = 0
    """Bias per g of specific force along each axis."""


class ImuErrors(CompactModel):
    """Errors of an inertial measurement unit."""

    accelerometer: AccelerometerErrors = AccelerometerErrors()
    """Errors of the accelerometers."""
    gyroscope: GyroscopeErrors = GyroscopeErrors()
    """Errors of the gyroscopes."""
    calibrated_at_c: Celsius = 25
    """Temperature at which the unit was calibrated."""
    self_heating_c: Annotated[Number, Field(ge=0, le=60)] = 0
    """Excess of a running unit's temperature over the air's."""
    warm_up_s: Annotated[Seconds, Field(ge=1, le=10_000)] = 300
    """Time constant of its warming from the scenario's start on."""


class RoadVibration(CompactModel):
    """Shaking of the unit by the road, which the vehicle's smooth motion does not have.

    A road of ISO 8608 under the quarter car of the International Roughness Index.
    """

    road: Literal["a", "b", "c", "d", "e"] = "b"
    """Class of ISO 8608, from very good to very poor."""
    horizontal_fraction: Fraction = 0.3
    """Acceleration forward and to the side as a fraction of the upward one."""


class Imu(Sampled):
    """Accelerometer, gyroscope and compass at the vehicle's origin."""

    grade: Literal["ideal", "low", "mid", "high", "consumer", "automotive", "tactical"] = "ideal"
    """Quality of the instrument; `ideal` has no errors. `low`, `mid` and `high` have noise and
    drift alone; `consumer`, `automotive` and `tactical` have all errors of a data sheet."""
    errors: ImuErrors | None = Field(default=None, exclude_if=is_none)
    """Errors of your own instrument, instead of a grade."""
    vibration: RoadVibration | None = Field(default=None, exclude_if=is_none)
    """Shaking by the road; `null` is none."""
    compass_noise_deg: Annotated[Degrees, Field(ge=0, le=90)] = 0
    """Standard deviation of the heading."""

    @property
    def instrument(self) -> ImuErrors:
        """Errors of its instruments."""
        return self.errors if self.errors is not None else IMU_GRADES[self.grade]


IMU_GRADES = {
    "ideal": ImuErrors(),
    # Noise and drift of gnss-ins-sim, from the sheets of Aceinna's AHRS380 and IMU381.
    "low": ImuErrors(
        accelerometer=AccelerometerErrors(noise_m_s_rth=0.05, bias_instability_ug=20.4),
        gyroscope=GyroscopeErrors(noise_deg_rth=0.75, bias_instability_deg_h=10),
    ),
    "mid": ImuErrors(
        accelerometer=AccelerometerErrors(noise_m_s_rth=0.03, bias_instability_ug=5.1),
        gyroscope=GyroscopeErrors(noise_deg_rth=0.25, bias_instability_deg_h=3.5),
    ),
    "high": ImuErrors(
        accelerometer=AccelerometerErrors(noise_m_s_rth=2.5e-5, bias_instability_ug=0.367),
        gyroscope=GyroscopeErrors(noise_deg_rth=2e-3, bias_instability_deg_h=0.1),
    ),
    # Bosch BMI088, BST-BMI088-DS001: 175 ug and 0.014 deg/s per root hertz, offsets of 20 mg and
    # 1 deg/s, 0.2 mg and 0.015 deg/s per degree, scale within 1 %, 0.1 deg/s per g. The sheet has
    # no Allan curve of the accelerometer and no rectification: those are assumed.
    "consumer": ImuErrors(
        accelerometer=AccelerometerErrors(
            noise_m_s_rth=0.103,
            bias_instability_ug=40,
            bias_walk_ug_rth=100,
            turn_on_bias_ug=20_000,
            bias_ug_per_c=200,
            scale_ppm=5000,
            scale_ppm_per_c=20,
            misalignment_mrad=5,
            rectification_ug_g2=500,
        ),
        gyroscope=GyroscopeErrors(
            noise_deg_rth=0.84,
            bias_instability_deg_h=2,
            bias_walk_deg_h_rth=20,
            turn_on_bias_deg_h=3600,
            bias_deg_h_per_c=54,
            scale_ppm=10_000,
            scale_ppm_per_c=300,
            misalignment_mrad=10,
            g_sensitivity_deg_h_g=360,
        ),
        self_heating_c=10,
        warm_up_s=300,
    ),
    # Analog Devices ADIS16470, Rev. C: 8 deg/h and 13 ug in run, 0.008 deg/s per root hertz,
    # calibrated over temperature. Its residual bias, scale, alignment and g-sensitivity are of
    # the order of its tables; walks of the biases are assumed.
    "automotive": ImuErrors(
        accelerometer=AccelerometerErrors(
            noise_m_s_rth=0.037,
            bias_instability_ug=13,
            bias_walk_ug_rth=30,
            turn_on_bias_ug=2000,
            bias_ug_per_c=20,
            scale_ppm=1000,
            scale_ppm_per_c=10,
            misalignment_mrad=1,
            rectification_ug_g2=100,
        ),
        gyroscope=GyroscopeErrors(
            noise_deg_rth=0.34,
            bias_instability_deg_h=8,
            bias_walk_deg_h_rth=10,
            turn_on_bias_deg_h=500,
            bias_deg_h_per_c=5,
            scale_ppm=2000,
            scale_ppm_per_c=20,
            misalignment_mrad=1,
            g_sensitivity_deg_h_g=36,
        ),
        self_heating_c=8,
        warm_up_s=300,
    ),
    # Sensonor STIM300, TS1524: 0.15 deg and 0.06 m/s per root hour, 0.5 deg/h and 0.05 mg, 500
    # and 300 ppm, 1 mrad, 0.75 mg from start to start, 1 deg/h per g compensated, 5 deg/h and
    # 2 mg over its range of 125 degrees. Walks of the biases and rectification are assumed.
    "tactical": ImuErrors(
        accelerometer=AccelerometerErrors(
            noise_m_s_rth=0.06,
            bias_instability_ug=50,
            bias_walk_ug_rth=20,
            turn_on_bias_ug=750,
            bias_ug_per_c=16,
            scale_ppm=300,
            misalignment_mrad=1,
            rectification_ug_g2=50,
        ),
        gyroscope=GyroscopeErrors(
            noise_deg_rth=0.15,
            bias_instability_deg_h=0.5,
            bias_walk_deg_h_rth=0.5,
            turn_on_bias_deg_h=10,
            bias_deg_h_per_c=0.04,
            scale_ppm=500,
            misalignment_mrad=1,
            g_sensitivity_deg_h_g=1,
        ),
        self_heating_c=5,
        warm_up_s=600,
    ),
}
"""Figures of the grades, by name."""
