# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of two images of one body that differ by scale, shift and brightness."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from cdff_common.arrays import Float32Array, FloatArray

#: Iterations at each resolution, and the change of scale below which they end.
_ITERATIONS, _CONVERGED = 12, 1e-5
#: Residual, in standard deviations, above which its weight decreases.
_HUBER = 1.5


class Similarity(NamedTuple):
    """Scale and shift of the image relative to the template about the origin of the template.

    Attributes
    ----------
    scale : float
    shift_px : ndarray (2,)
    scale_sigma : float
        For residuals that are independent between pixels.
    agreement : float
        Correlation of the image with the moved template.
    """

    scale: float
    shift_px: FloatArray
    scale_sigma: float
    agreement: float


def register_similarity(
    image: Float32Array, template: Float32Array, origin_px: FloatArray, blurs_px: tuple[float, ...]
) -> Similarity:
    """Return the similarity by Gauss-Newton with Huber weights, from coarse to fine.

    Parameters
    ----------
    image, template : ndarray (r, c)
        Brightness in the same unit, up to gain and offset.
    origin_px : ndarray (2,)
        Column and row of the fixed point of the scale.
    blurs_px : tuple of float
        Standard deviations of the smoothing, the coarsest first; 0 for none.
    """
    scale, shift = 1.0, np.zeros(2)
    sigma = agreement = float("nan")
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]].astype(float)
    for blur in blurs_px:
        target, source = _smooth(image, blur), _smooth(template, blur)
        for _ in range(_ITERATIONS):
            warped_source = _scale_and_shift(source, origin_px, scale, shift)
            gx, gy = (
                cv2.Sobel(warped_source, cv2.CV_64F, 1, 0, scale=0.125),
                cv2.Sobel(warped_source, cv2.CV_64F, 0, 1, scale=0.125),
            )
            x, y = columns - origin_px[0] - shift[0], rows - origin_px[1] - shift[1]
            A = np.stack(
                [
                    -(gx * x + gy * y).ravel(),
                    -gx.ravel(),
                    -gy.ravel(),
                    warped_source.ravel(),
                    np.ones(warped_source.size),
                ],
                axis=1,
            )
            weights = np.ones(len(A))
            for _ in range(2):
                root = np.sqrt(weights)[:, None]
                solution = np.linalg.lstsq(A * root, target.ravel() * root[:, 0], rcond=None)[0]
                residual = target.ravel() - A @ solution
                spread = max(float(np.sqrt(np.mean(residual**2))), 1e-9)
                weights = np.minimum(1.0, _HUBER * spread / np.maximum(np.abs(residual), 1e-12))
            gain = solution[3] if abs(solution[3]) > 1e-6 else 1.0
            step = np.clip(solution[:3] / gain, [-0.2, -20.0, -20.0], [0.2, 20.0, 20.0])
            scale *= float(np.exp(step[0]))
            shift = shift + step[1:]
            if not 0.2 < scale < 5.0:
                return Similarity(scale, shift, float("inf"), 0.0)
            if abs(step[0]) < _CONVERGED and np.abs(step[1:]).max() < 1e-2:
                break
        agreement = (
            float(np.corrcoef(target.ravel(), warped_source.ravel())[0, 1])
            if warped_source.std() > 0.0
            else 0.0
        )
        information = A.T @ (A * weights[:, None])
        covariance = np.linalg.pinv(information) * spread**2
        sigma = float(np.sqrt(max(covariance[0, 0], 0.0)) / abs(gain))
    return Similarity(scale, shift, sigma, agreement)


def _smooth(image: Float32Array, sigma_px: float) -> Float32Array:
    if sigma_px <= 0.0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)


def _scale_and_shift(
    image: Float32Array, origin: FloatArray, scale: float, shift: FloatArray
) -> Float32Array:
    """Return the image scaled about its origin and shifted."""
    forward = np.array([[scale, 0.0, 0.0], [0.0, scale, 0.0]])
    forward[:, 2] = origin + shift - scale * origin
    size = (image.shape[1], image.shape[0])
    flags = cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR
    return np.asarray(cv2.warpAffine(image, forward, size, flags=flags), np.float32)
