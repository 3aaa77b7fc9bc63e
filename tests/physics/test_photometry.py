"""Cubemaps."""

import math

import numpy as np
import pytest

from advercity.physics import photometry


def test_cubemap_faces_have_the_documented_axes() -> None:
    upper_left = photometry.cubemap_directions(2)[:, 0, 0] * math.sqrt(1.5)
    expected = [
        (1, 0.5, 0.5),
        (-1, -0.5, 0.5),
        (-0.5, 1, 0.5),
        (0.5, -1, 0.5),
        (-0.5, 0.5, 1),
        (0.5, 0.5, -1),
    ]
    np.testing.assert_allclose(upper_left, expected, atol=1e-12)
    assert 6 * photometry.cubemap_solid_angles(64).sum() == pytest.approx(12.5671, abs=1e-4)


def test_stacked_faces_go_on_in_their_neighbours() -> None:
    size = 64
    faces = photometry.cubemap_directions(size).astype(np.float32)
    stacked = photometry.stack_cubemap(faces).reshape(6, size + 2, size + 2, 3)

    np.testing.assert_array_equal(stacked[:, 1:-1, 1:-1], faces)
    # A face's own plane goes on beyond its edge: by a texel from the middle of the last one.
    beyond = np.array([1.0 + 1.0 / size, 1.0, (np.arange(size) + 0.5)[20] / size * 2.0 - 1.0])
    for face in range(6):
        ahead, right = photometry.cubemap_directions(1)[face, 0, 0], faces[face, 20, -1]
        across = faces[face, 20, -1] - faces[face, 20, 0]
        down = faces[face, -1, 20] - faces[face, 0, 20]
        across, down = across / np.linalg.norm(across), down / np.linalg.norm(down)
        expected = beyond[1] * ahead + beyond[0] * across + beyond[2] * down
        expected /= np.linalg.norm(expected)
        found = stacked[face, 21, -1]
        np.testing.assert_allclose(found / np.linalg.norm(found), expected, atol=1e-3)
        assert np.linalg.norm(found - right) < 0.05


def test_a_black_body_has_luminance_1_and_the_colour_of_its_temperature() -> None:
    for temperature_k in (2700, 3000, 3200, 4000, 5000, 6500, 8000, 10_000):
        colour = photometry.black_body_colour(temperature_k)
        assert float(colour @ [0.2126, 0.7152, 0.0722]) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(photometry.black_body_colour(6500), 1.0, atol=1e-12)
    # By chromaticities of Planck's law, of 2856 K (illuminant A) among others.
    for temperature_k, xy in {2856: (0.4476, 0.4074), 4000: (0.3805, 0.3768)}.items():
        expected = photometry.colour_from_chromaticity(np.array(xy))
        np.testing.assert_allclose(photometry.black_body_colour(temperature_k), expected, atol=0.05)


def test_the_white_of_a_monitor_is_white_and_its_primaries_are_pure() -> None:
    white = photometry.colour_from_chromaticity(np.array([0.3127, 0.3290]))
    np.testing.assert_allclose(white, 1.0, atol=2e-3)
    for channel, xy in enumerate([(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)]):
        primary = photometry.colour_from_chromaticity(np.array(xy))
        expected = np.eye(3)[channel] / photometry.LUMINANCE_WEIGHTS[channel]
        np.testing.assert_allclose(primary, expected, atol=0.01)
