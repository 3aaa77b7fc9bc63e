import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Camera, Exposure, Mount, Weather
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.sensors.camera import ExposureSettings, digitise, expose_image, meter_exposure
from advercity.sensors.camera.electronics import build_tone_curve
from advercity.sensors.camera.optics import add_stray_light
from advercity.sensors.camera.scene_light import add_sun_disc

Array = NDArray[np.float32]
WIDTH, HEIGHT = 240, 135
FOV_RAD = math.radians(100)
FOCAL_PX = WIDTH / 2 / math.tan(FOV_RAD / 2)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def camera(*, noise: bool = False, highlights_ev: float = 4, **exposure: Any) -> Camera:
    return Camera(
        width_px=WIDTH,
        height_px=HEIGHT,
        mounts=(Mount(),),
        noise=noise,
        highlights_ev=highlights_ev,
        exposure=Exposure(**exposure),
    )


def grey(luminance: float) -> Array:
    return np.full((HEIGHT, WIDTH, 3), luminance, np.float32)


def capture(radiance: Array, depth: float = 10.0) -> CameraCapture:
    height, width = radiance.shape[:2]
    return CameraCapture(
        radiance=radiance,
        depth=np.full((height, width), depth, np.float32),
        normal=np.zeros((height, width, 3), np.float32),
        semantic=np.zeros((height, width), np.uint8),
        instance=np.zeros((height, width), np.int32),
    )


def picture(radiance: Array, taken_by: Camera, *key: int) -> NDArray[np.uint8]:
    return expose_image(
        radiance,
        taken_by,
        meter_exposure(radiance, taken_by.exposure),
        create_generator("test", *key),
    ).image


@pytest.mark.parametrize("mode", ["auto", "sensor"])
@pytest.mark.parametrize(("compensation_ev", "value"), [(0.79, 118), (0.0, 91)])
@pytest.mark.parametrize("luminance", [1.0, 30.0, 400.0, 5500.0])
def test_automatic_exposure_puts_any_card_at_the_same_grey(
    luminance: float, compensation_ev: float, value: int, mode: str
) -> None:
    taken = picture(grey(luminance), camera(mode=mode, compensation_ev=compensation_ev))
    np.testing.assert_allclose(taken.astype(int), value, atol=2)


def test_a_night_too_dark_for_automatic_exposure_stays_dark() -> None:
    dim, dimmer = (picture(grey(level), camera()).mean() for level in (0.1, 0.01))
    assert 91 > dim > 5 * dimmer


def test_f_1_4_at_a_200th_and_iso_100_saturates_at_470_candelas() -> None:
    by_hand = camera(mode="manual")
    setting = meter_exposure(grey(1.0), by_hand.exposure)
    assert setting.ev100 == pytest.approx(8.61, abs=0.01)
    assert setting.saturation_cd_m2 == pytest.approx(470, rel=0.01)
    assert picture(grey(setting.saturation_cd_m2), by_hand).min() == 255
    assert picture(grey(0.98 * setting.saturation_cd_m2), by_hand).max() < 255


def test_four_times_the_sensitivity_saturates_at_a_quarter_of_the_light() -> None:
    base, fast = (meter_exposure(grey(1.0), Exposure(mode="manual", iso=iso)) for iso in (100, 400))
    assert fast.saturation_cd_m2 == pytest.approx(base.saturation_cd_m2 / 4)
    assert fast.full_well_e == base.full_well_e / 4


def test_daylight_is_filtered_and_darkness_is_amplified() -> None:
    by_day, by_night = (meter_exposure(grey(level), Exposure()) for level in (3000.0, 1.0))
    assert by_day.iso == 100
    assert by_night.ev100 == pytest.approx(math.log2(8))
    assert by_night.iso == pytest.approx(100 * 2 ** (8.6147 - by_night.ev100), rel=1e-3)


@pytest.mark.parametrize(
    ("luminance", "shutter_s", "iso", "ev100"),
    [
        pytest.param(20_000, 20e-6, 100, 16.580, id="more light than it can shut out"),
        pytest.param(3183, 76.97e-6, 100, 14.636, id="sunlit asphalt"),
        pytest.param(477, 513.6e-6, 100, 11.898, id="overcast asphalt"),
        pytest.param(32, 7.656e-3, 100, 8.0, id="dusk"),
        pytest.param(7.35, 1 / 30, 100, 5.878, id="where gain begins"),
        pytest.param(1.0, 1 / 30, 735, 3.0, id="lit street"),
        pytest.param(0.0083, 1 / 30, 10_000, -0.766, id="moonlit asphalt"),
    ],
)
def test_a_sensor_by_itself_moves_its_shutter_first_and_then_its_gain(
    luminance: float, shutter_s: float, iso: float, ev100: float
) -> None:
    setting = meter_exposure(grey(luminance), Exposure(mode="sensor", compensation_ev=0))
    assert setting.shutter_s == pytest.approx(shutter_s, rel=1e-3)
    assert setting.iso == pytest.approx(iso, rel=1e-3)
    assert setting.ev100 == pytest.approx(ev100, abs=1e-3)


def test_gain_above_base_is_given_up_where_the_shutter_cannot_be_shorter() -> None:
    setting = meter_exposure(grey(10_000.0), Exposure(mode="sensor", iso=400, compensation_ev=0))
    assert (setting.shutter_s, setting.iso) == (20e-6, pytest.approx(122.5))


def test_a_longer_shutter_is_used_where_one_is_authored() -> None:
    setting = meter_exposure(grey(1.0), Exposure(mode="sensor", shutter_s=0.04, compensation_ev=0))
    assert (setting.shutter_s, setting.iso) == (0.04, pytest.approx(612.5))


@pytest.mark.parametrize("mode", ["auto", "manual"])
@pytest.mark.parametrize("luminance", [1e-3, 1.0, 5000.0])
def test_only_a_sensor_by_itself_moves_the_shutter(mode: Any, luminance: float) -> None:
    assert meter_exposure(grey(luminance), Exposure(mode=mode, shutter_s=0.002)).shutter_s == 0.002


def test_a_shutter_open_for_longer_makes_a_night_less_noisy() -> None:
    """A middle grey of 21 electrons against one of 142, each with 3 of read noise."""
    steady, longer = (
        picture(grey(1.0), camera(noise=True, mode=mode)).astype(float).std()
        for mode in ("auto", "sensor")
    )
    assert steady / longer == pytest.approx(3.01, rel=0.1)


def test_the_meter_looks_at_the_lower_two_thirds_without_highlights() -> None:
    scene = grey(100.0)
    scene[: HEIGHT // 3] = 1e5
    scene[60:63, 100:110] = 1e6
    assert meter_exposure(scene, Exposure()).ev100 == pytest.approx(
        meter_exposure(grey(100.0), Exposure()).ev100
    )


def under_a_bright_sky(stops: float) -> Array:
    """Road that is metered, below a sky so many stops brighter."""
    scene = grey(100.0)
    scene[: HEIGHT // 3] = 100.0 * 2.0**stops * np.linspace(0.5, 1.0, WIDTH)[None, :, None]
    return scene


def test_a_bright_sky_is_rolled_off_where_a_plain_sensor_clips() -> None:
    scene = under_a_bright_sky(5)
    rolled, clipped = (
        picture(scene, camera(highlights_ev=stops))[: HEIGHT // 3].astype(int) for stops in (4, 0)
    )
    assert (clipped == 255).all()
    # A fiftieth of the picture is white, all of it in the upper third, and what rounds to it.
    assert (rolled == 255).mean() < 3 / 50 + 0.03
    across = rolled[0, :, 0]
    assert (np.diff(across) >= 0).all()
    assert across[0] < 240
    assert across[-1] >= 252


def test_a_bright_sky_leaves_the_road_as_it_is() -> None:
    road = [picture(under_a_bright_sky(stops), camera())[HEIGHT // 3 :] for stops in (0, 3, 5)]
    np.testing.assert_array_equal(road[0], road[1])
    np.testing.assert_array_equal(road[0], road[2])


def test_without_highlights_the_tone_curve_is_that_of_srgb() -> None:
    shares = np.array([0.0, 0.18, 0.5, 1.0])
    values = build_tone_curve(0.0)[np.rint(shares * 4095).astype(int)]
    np.testing.assert_allclose(values, [0, 117.6, 187.5, 255], atol=0.6)


def test_the_tone_curve_rises_from_middle_grey_to_white_without_a_kink() -> None:
    grey_dn, whitest_dn = round(0.18 * 4095), 8 * 4095
    plain, rolled = build_tone_curve(0.0).astype(int), build_tone_curve(3.0).astype(int)
    np.testing.assert_array_equal(rolled[: grey_dn + 1], plain[: grey_dn + 1])
    assert (np.diff(rolled) >= 0).all()
    assert rolled[whitest_dn] == 255
    assert rolled[whitest_dn // 2] < 250
    assert plain[grey_dn + 100] - rolled[grey_dn + 100] <= 1


@pytest.mark.parametrize(("albedo", "value"), [(0.85, 186), (0.5, 146), (0.18, 91), (0.05, 91)])
def test_what_is_lighter_than_a_grey_card_in_the_same_light_stays_lighter(
    albedo: float, value: int
) -> None:
    lit = grey(albedo * 5000.0)
    setting = meter_exposure(lit, Exposure(), white_card_cd_m2=5000.0)
    taken = expose_image(lit, camera(), setting, create_generator("test")).image
    np.testing.assert_allclose(taken.astype(int), value, atol=2)


def test_noise_follows_the_photon_transfer_curve() -> None:
    setting = ExposureSettings(ev100=8.61, iso=100, shutter_s=0.005)
    gain = 4095 / setting.full_well_e
    levels = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8], np.float32)
    shares = np.broadcast_to(levels[:, None], (6, 200_000)).astype(np.float32)
    digital = digitise(shares, setting, create_generator("test")).astype(np.float64)
    slope, offset = np.polyfit(digital.mean(axis=1), digital.var(axis=1), 1)
    assert slope == pytest.approx(gain, rel=0.03)
    dark = digitise(np.full(200_000, 0.004, np.float32), setting, create_generator("dark"))
    read_variance = dark.astype(np.float64).var() - 1 / 12 - gain**2 * 40
    assert math.sqrt(read_variance) / gain == pytest.approx(3.0, rel=0.03)
    assert abs(offset) < 60


@pytest.mark.parametrize(("share", "ratio"), [(0.5, 70.6), (0.18, 42.3), (0.01, 9.6)])
def test_signal_to_noise_is_that_of_ten_thousand_electrons(share: float, ratio: float) -> None:
    digital = digitise(
        np.full(400_000, share, np.float32),
        ExposureSettings(8.61, 100, 0.005),
        create_generator("test"),
    ).astype(np.float64)
    assert digital.mean() / digital.std() == pytest.approx(ratio, rel=0.01)


def test_noise_can_be_turned_off_and_is_the_same_for_the_same_key() -> None:
    noisy = camera(noise=True)
    assert picture(grey(50.0), camera()).std() == 0
    np.testing.assert_array_equal(picture(grey(50.0), noisy, 1), picture(grey(50.0), noisy, 1))
    assert (picture(grey(50.0), noisy, 1) != picture(grey(50.0), noisy, 2)).any()


def test_a_night_is_noisier_than_a_day() -> None:
    by_day, by_night = (
        picture(grey(level), camera(noise=True)).astype(float).std() for level in (3000.0, 1.0)
    )
    assert by_night > 3 * by_day


def test_a_lens_moves_light_and_loses_none() -> None:
    scene = grey(1.0)
    scene[60:66, 110:118] = 1e5
    spread = add_stray_light(scene, horizontal_fov_rad=FOV_RAD, fraction=0.05)
    assert spread.sum() == pytest.approx(scene.sum(), rel=0.005)
    assert spread[63, 114, 0] < scene[63, 114, 0]
    assert spread[20, 20, 0] > scene[20, 20, 0]


def test_a_lens_scatters_no_light_beyond_sixty_degrees() -> None:
    scene = np.zeros((8, 256, 3), np.float32)
    scene[:, 0] = 1e9
    veil = add_stray_light(scene, horizontal_fov_rad=np.radians(150.0), fraction=0.5)[4, :, 0]
    # 34.3 px of focal length: 60 degrees off the axis are 59.4 px away.
    assert veil[50] > 100.0
    assert (veil[61:] < 0.01).all()


def test_a_lens_leaves_an_even_field_as_it_is() -> None:
    spread = add_stray_light(grey(7.0), horizontal_fov_rad=FOV_RAD, fraction=0.1)
    np.testing.assert_allclose(spread, 7.0, rtol=1e-4)


@cache
def low_sun(azimuth_deg: float = 90.0, elevation_deg: float = 8.0) -> Atmosphere:
    sun = {"elevation_deg": elevation_deg, "azimuth_deg": azimuth_deg}
    sky = {"direct_lx": 60_000}
    return compute_atmosphere(
        Weather.model_validate({"id": "tried", "time": "day", "sun": sun, "sky": sky}), "rural"
    )


def facing(*, width_px: int = WIDTH, yaw: float = 0.0) -> CameraView:
    return CameraView(pose_matrix((0, 0, 1.5), yaw=yaw), width_px, width_px * 9 // 16, FOV_RAD)


@pytest.mark.parametrize("width_px", [120, 240, 960])
@pytest.mark.parametrize("yaw", [0.0, 0.01, -0.4])
def test_the_sun_in_the_picture_gives_the_suns_illuminance(width_px: int, yaw: float) -> None:
    view = facing(width_px=width_px, yaw=yaw)
    black = capture(np.zeros((view.height_px, width_px, 3), np.float32), np.inf)
    assert illuminance(add_sun_disc(black, view, low_sun())) == pytest.approx(60_000, rel=1e-3)


def test_the_sun_between_four_pixels_of_a_tiny_picture_is_not_lost() -> None:
    """Half a pixel above the middle of 16 x 9 pixels, where four meet."""
    focal_px = 8 / math.tan(FOV_RAD / 2)
    black = capture(np.zeros((9, 16, 3), np.float32), np.inf)
    sun = low_sun(elevation_deg=math.degrees(math.atan(0.5 / focal_px)))
    found = add_sun_disc(black, facing(width_px=16), sun)
    assert illuminance(found) == pytest.approx(60_000, rel=1e-3)


def illuminance(found: CameraCapture) -> float:
    """Of all that a picture shows, on a plane that faces the camera's pixels one by one, lx."""
    height, width = found.depth.shape
    focal_px = width / 2 / math.tan(FOV_RAD / 2)
    row, column = np.mgrid[:height, :width] + 0.5
    distance = np.sqrt(focal_px**2 + (row - height / 2) ** 2 + (column - width / 2) ** 2)
    luminance = found.radiance.astype(np.float64) @ LUMINANCE
    return float(np.sum(luminance * focal_px / distance**3))


@settings(max_examples=20)
@given(yaw=st.floats(-0.6, 0.6), elevation_deg=st.sampled_from([1, 8, 25]))
def test_the_sun_is_where_its_direction_says(yaw: float, elevation_deg: float) -> None:
    view = facing(width_px=960, yaw=yaw)
    black = capture(np.zeros((540, 960, 3), np.float32), np.inf)
    light = add_sun_disc(black, view, low_sun(elevation_deg=elevation_deg)).radiance[..., 1]
    middle = [np.average(at + 0.5, weights=light) for at in np.indices(light.shape)]
    focal_px = 480 / math.tan(FOV_RAD / 2)
    rise = math.tan(math.radians(elevation_deg)) / math.cos(yaw)
    expected = [270 - focal_px * rise, 480 + focal_px * math.tan(yaw)]
    # A disc of four pixels, stretched away from the middle of the picture.
    np.testing.assert_allclose(middle, expected, atol=0.3)


def test_what_is_in_front_of_the_sun_hides_it() -> None:
    assert not add_sun_disc(capture(grey(0.0), 50.0), facing(), low_sun()).radiance.any()


@pytest.mark.parametrize("azimuth_deg", [270, 0, 0.3, 1, 10])
def test_a_sun_outside_the_field_of_view_leaves_the_image_unchanged(azimuth_deg: float) -> None:
    scene = capture(grey(1.0), np.inf)
    found = add_sun_disc(scene, facing(), low_sun(azimuth_deg))
    np.testing.assert_array_equal(found.radiance, scene.radiance)


@pytest.mark.parametrize(("off_deg", "veil_cd_m2"), [(2, 3.6e4), (5, 2_500), (10, 315), (20, 40)])
def test_the_suns_veil_falls_off_as_the_lens_scatters(off_deg: float, veil_cd_m2: float) -> None:
    view = facing(width_px=960)
    black = capture(np.zeros((540, 960, 3), np.float32), np.inf)
    lit = add_sun_disc(black, view, low_sun(elevation_deg=0.001)).radiance
    veiled = add_stray_light(lit, horizontal_fov_rad=FOV_RAD, fraction=0.02) @ LUMINANCE
    focal_px = 480 / math.tan(FOV_RAD / 2)
    column = round(480 + focal_px * math.tan(math.radians(off_deg)))
    assert veiled[270, column] == pytest.approx(veil_cd_m2, rel=0.05)


@given(darker=st.floats(1.0, 100.0), brighter=st.floats(1.01, 4.0))
def test_more_light_never_darkens_a_picture(darker: float, brighter: float) -> None:
    by_hand = camera(mode="manual")
    low, high = (picture(grey(level), by_hand) for level in (darker, darker * brighter))
    assert (high >= low).all()
