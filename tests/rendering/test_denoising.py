"""Taking out the noise of few samples leaves the light and the edges."""

import numpy as np
import pytest

from advercity.rendering.denoising import denoise


def test_noise_goes_and_light_stays() -> None:
    rng = np.random.default_rng(5)
    albedo = np.full((96, 128, 3), 0.2, np.float32)
    albedo[:, 64:] = 0.8
    normal = np.zeros_like(albedo)
    normal[..., 2] = 1.0
    light = 3.0 * albedo
    noisy = (light * rng.exponential(1.0, albedo.shape)).astype(np.float32)
    calm = denoise(noisy, albedo, normal)
    assert np.abs(calm - light).mean() < 0.15 * np.abs(noisy - light).mean()
    assert calm[:, :60].mean() == pytest.approx(noisy[:, :60].mean(), rel=0.03)
    assert calm[:, 67].mean() > 3.0 * calm[:, 61].mean()


def test_the_same_picture_comes_out_the_same() -> None:
    noisy = np.random.default_rng(6).random((64, 48, 3), np.float32)
    guide = np.full_like(noisy, 0.5)
    first, second = (denoise(noisy, guide, guide) for _ in range(2))
    np.testing.assert_array_equal(first, second)
