"""Rotation vectors."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from advercity.geometry.poses import rotation_matrix, to_rotation_vector


@given(x=st.floats(-1.7, 1.7), y=st.floats(-1.7, 1.7), z=st.floats(-1.7, 1.7))
def test_a_rotation_gives_its_axis_and_angle_back(x: float, y: float, z: float) -> None:
    vector = np.array([x, y, z])
    angle = float(np.linalg.norm(vector))
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned = (
        np.eye(3)
        + np.sinc(angle / np.pi) * across
        + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * across @ across
    )
    np.testing.assert_allclose(to_rotation_vector(turned), vector, atol=1e-6)


def test_a_yaw_is_a_rotation_about_the_vertical() -> None:
    np.testing.assert_allclose(
        to_rotation_vector(rotation_matrix(yaw=0.3)), [0, 0, 0.3], atol=1e-12
    )
