"""Projection by OpenCV, whose lens models are the reference of ours."""

import cv2
import numpy as np
from advercity_dsl.lens import CameraLens, KannalaBrandtLens

from advercity.geometry.arrays import Float64Array
from advercity.sensors.camera_model import CameraModel


def project_points(model: CameraModel, lens: CameraLens, points: Float64Array) -> Float64Array:
    """Project points (n, 3) in body axes to pixels (n, 2)."""
    optical = np.stack([-points[:, 1], -points[:, 2], points[:, 0]], axis=1)[:, None]
    still, coefficients = np.zeros(3), np.array(lens.coefficients)
    if isinstance(lens, KannalaBrandtLens):
        pixels, _ = cv2.fisheye.projectPoints(optical, still, still, model.matrix, coefficients)
    else:
        pixels, _ = cv2.projectPoints(optical, still, still, model.matrix, coefficients)
    return pixels.reshape(-1, 2).astype(np.float64)


def find_rays(model: CameraModel, lens: CameraLens) -> Float64Array:
    """Find the rays (h, w, 3) in body axes of a camera's pixels, by its projection."""
    grid = np.meshgrid(np.arange(model.width_px) + 0.5, np.arange(model.height_px) + 0.5)
    pixels = np.stack(grid, axis=-1).reshape(-1, 2)
    rays = np.ones((len(pixels), 3))
    rays[:, 1:] = ((model.width_px / 2, model.height_px / 2) - pixels) / model.focal_px
    for _ in range(60):
        rays[:, 1:] += (project_points(model, lens, rays) - pixels) / model.focal_px
    np.testing.assert_allclose(project_points(model, lens, rays), pixels, atol=0.02)
    return rays.reshape(model.height_px, model.width_px, 3)
