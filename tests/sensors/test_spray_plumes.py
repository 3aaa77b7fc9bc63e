"""The same plumes of spray for LiDAR, camera and radar, by numbers computed by hand.

Behind a vehicle at 60 km/h 0.5 g/m³ of drops of 0.1 mm take 0.015 of the light per metre; over a
plume of 12 m, which falls to 1/e in 6.5 m, that is 0.015 x 6.5 (1 - exp(-12 / 6.5)) = 0.0821.
"""

import math

import numpy as np
import pytest
from advercity_dsl import Camera, Lidar, Mount

from advercity.frames import ActorClass, ActorState, Frame
from advercity.geometry.poses import pose_matrix
from advercity.physics.microwaves import WAVELENGTH_M, water_permittivity
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.sensors.camera import CameraExposure
from advercity.sensors.camera.scene_light import AmbientLight
from advercity.sensors.camera.spray_veil import add_spray
from advercity.sensors.lidar.volume_scattering import find_plume_crossings
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar import PlacedRadar
from advercity.sensors.radar.antenna import compute_gain
from advercity.sensors.radar.clutter import list_spray_paths
from advercity.sensors.spray_plumes import SprayPlume, has_spray, iterate_spraying_states
from advercity.testing import make_actor_state
from tests.sensors.radar.builders import WIDE

KM_H = 1 / 3.6
SIZE = (4.0, 2.0, 1.5)
BEHIND = pose_matrix((-30.0, 0.0, 0.65))
"""At half the height of the plume of a vehicle at the origin, 16 m behind its end."""
DEPTH_AT_60_KM_H = 0.015 * 6.5 * (1 - math.exp(-12 / 6.5))


def driving(speed_km_h: float, actor_class: ActorClass = "car", x_m: float = 0.0) -> ActorState:
    speed_m_s = speed_km_h * KM_H
    return make_actor_state(7, x_m, speed_m_s=speed_m_s, size=SIZE, actor_class=actor_class)


@pytest.mark.parametrize(("speed_km_h", "peak_per_m"), [(60, 0.015), (120, 0.06), (30, 0.00375)])
def test_a_plume_is_as_long_wide_and_dense_as_wheels_make_it(
    speed_km_h: float, peak_per_m: float
) -> None:
    plume = SprayPlume.from_state(driving(speed_km_h))
    low, high = plume.corners.min(axis=0), plume.corners.max(axis=0)
    np.testing.assert_allclose([low, high], [(-14, -1, 0), (-2, 1, 1.3)], atol=1e-9)
    assert plume.peak_extinction_per_m == pytest.approx(peak_per_m)


def test_spray_needs_03_mm_of_water_30_km_h_and_wheels_that_throw_it_up() -> None:
    assert [has_spray(film_mm) for film_mm in (0.29, 0.3, 0.31)] == [False, False, True]
    classes: tuple[ActorClass, ...] = ("car", "van", "truck", "motorcycle", "bicycle", "pedestrian")
    states = [driving(60, one) for one in classes]
    assert list(iterate_spraying_states(states)) == states[:4]
    slow, fast = driving(29.9), driving(30.1)
    assert list(iterate_spraying_states([slow, fast])) == [fast]


def test_a_beam_along_a_plume_crosses_12_m_of_it() -> None:
    lidar = Lidar(lower_deg=-10, upper_deg=10, channels=21)
    (found,) = find_plume_crossings(lidar, BEHIND, [driving(60)])
    along = int(found.through_m.argmax())
    assert found.enter_m[along] == pytest.approx(16.0, abs=0.02)
    assert found.through_m[along] == pytest.approx(12.0, abs=0.02)
    # In the middle of the path, 6 m behind the vehicle.
    assert found.extinction_per_m[along] == pytest.approx(0.015 * math.exp(-6 / 6.5), rel=1e-3)
    assert list(find_plume_crossings(lidar, BEHIND, [driving(60, x_m=40)])) == []


def test_a_camera_sees_through_a_plume_what_its_water_leaves() -> None:
    """In its middle a plume has 0.75 / (4/9) times its mean, which is the LiDAR's."""
    view = CameraView(BEHIND, 101, 51, math.radians(20.0))
    frame = Frame(0, 0.0, (driving(60),), {})
    exposure = CameraExposure(view, Camera(mounts=(Mount(),)), frame, np.zeros(3), ())
    up = np.array([0, 0, 1.0])
    ambient = AmbientLight(
        directions=up[None],
        luminance=np.full((1, 3), 100.0),
        solid_angle_fraction=np.ones(1),
        sun=up,
        sun_lx=np.full(3, 1000.0 * math.pi),
    )
    seen = CameraCapture(
        radiance=np.full((51, 101, 3), 500.0, np.float32),
        depth=np.full((51, 101), 28.0, np.float32),
        normal=np.zeros((51, 101, 3), np.float32),
        semantic=np.zeros((51, 101), np.uint8),
        instance=np.zeros((51, 101), np.int32),
    )
    veiled = add_spray(seen, exposure, ambient, water_film_mm=1.0).radiance[25, 50]
    left = math.exp(-0.75 / (4 / 9) * DEPTH_AT_60_KM_H)
    # Before a background of 500, drops of 100 from around and 1000 pi / 4 pi from the sun.
    np.testing.assert_allclose(veiled, 500 * left + (100 + 250) * (1 - left), rtol=1e-3)


def test_a_radar_sees_the_water_of_a_plume_thin_out_and_follow_at_half_the_speed() -> None:
    radar, state = PlacedRadar(WIDE, WIDE.mounts[0], BEHIND, np.zeros(3)), driving(60)
    (paths,) = list_spray_paths(radar, [state])
    points = paths.direction.astype(float) * paths.range_m[:, None].astype(float)
    section_m2 = paths.strength * paths.range_m.astype(float) ** 4
    section_m2 /= compute_gain(WIDE, paths.direction.astype(float)) ** 2
    assert (paths.kind == PointKind.SPRAY).all()
    assert not paths.instance.any()
    # From 16 m ahead, in the middles of twelve slices of 1 m.
    slices_m = np.unique(points[:, 0].round(3))
    np.testing.assert_allclose(slices_m, 16.5 + np.arange(12), atol=2e-3)
    by_slice = [section_m2[np.isclose(points[:, 0], at_m, atol=5e-3)].sum() for at_m in slices_m]
    np.testing.assert_allclose(np.divide(by_slice[1:], by_slice[:-1]), math.exp(1 / 6.5), rtol=1e-3)
    ahead = paths.direction[:, 0]
    np.testing.assert_allclose(paths.rate_m_s, 0.5 * 60 * KM_H * ahead, rtol=1e-5)
    # Rayleigh's limit for exponential sizes of slope 30/mm: 2.6 m³ a slice, 0.5 g/m³ at the front.
    epsilon = water_permittivity()
    intercept_per_m4 = 1e-6 * 0.5 * 30e3**4 / math.pi
    moment = intercept_per_m4 * math.factorial(6) / 30e3**7
    factor = abs((epsilon - 1) / (epsilon + 2)) ** 2
    eta = math.pi**5 / WAVELENGTH_M**4 * factor * moment
    assert by_slice[-1] == pytest.approx(2.6 * eta * math.exp(-0.5 / 6.5), rel=0.1)
    assert list(list_spray_paths(radar, [driving(60, x_m=40)])) == []
