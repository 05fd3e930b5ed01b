# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Focal length of a camera, estimated together with its pose from points of a map."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_core.visual_map.pose_fit import linearised_directions, robust_step

#: Gauss-Newton steps.
_ITERATIONS = 8
#: Largest number of images of a camera that are compared, least number for a result, and number of standard
#: deviations of a significant error.
_IMAGES, _MIN_IMAGES, _SIGNIFICANT = 40, 8, 4.0
#: Relative error above which a single image is reported: a smaller one may be an error of the map.
_MAX_ERROR_OF_ONE = 0.05


@dataclass(frozen=True, slots=True)
class FocalRatio:
    """Ratio of the estimated focal length to the stated one, with its formal standard deviation."""

    value: float
    sigma: float


def fit_focal_ratio(
    T_camera_map: FloatArray,
    points: FloatArray,
    covariances: FloatArray,
    directions: FloatArray,
    sigma: float,
    gate: float,
) -> FocalRatio | None:
    """Return the ratio of the focal lengths from a fit of pose and ratio, with Tukey's weights.

    The residual of a point is that of ``fit_pose`` with the measured direction divided by the ratio. The
    parameters are those of ``fit_pose``, which also gives the first estimate of the pose.

    Returns
    -------
    FocalRatio or None
        None if the points do not determine the ratio, as on a plane across the axis of the camera.
    """
    T, ratio = np.array(T_camera_map), 1.0
    for _ in range(_ITERATIONS):
        residuals, by_pose, W = linearised_directions(T, points, covariances, directions / ratio, sigma)
        J = np.concatenate([by_pose, (directions / ratio**2)[:, :, None]], axis=2)
        try:
            _, _, normal, step = robust_step(residuals, J, W, gate)
        except RefusedError:
            return None
        T, ratio = se3.exp_se3(step[:6]) @ T, ratio + float(step[6])
        if not 0.2 < ratio < 5.0:
            return None
    return FocalRatio(ratio, float(np.sqrt(np.linalg.inv(normal)[6, 6])))


class FocalMonitor:
    """Compares the focal length of a camera with the stated one, in single images and over many.

    Parameters
    ----------
    max_error : float
        Relative error of the median of many images that is reported.
    """

    def __init__(self, max_error: float) -> None:
        self._max_error = max_error
        self.clear()

    def clear(self) -> None:
        """Remove all images."""
        self._focal_px = 0.0
        self._ratios: deque[float] = deque(maxlen=_IMAGES)

    def estimate_px(self, focal_px: float, ratio: FocalRatio) -> float | None:
        """Add an image; return the estimated focal length if it contradicts the stated one, else None."""
        if focal_px != self._focal_px:
            self.clear()
            self._focal_px = focal_px
        self._ratios.append(ratio.value)
        error = abs(ratio.value - 1.0)
        if error > max(_MAX_ERROR_OF_ONE, self._max_error) and error > _SIGNIFICANT * ratio.sigma:
            return ratio.value * focal_px
        if len(self._ratios) < _MIN_IMAGES:
            return None
        ratios = np.array(self._ratios)
        median = float(np.median(ratios))
        # Standard deviation of the median of a normal distribution, from the median absolute deviation.
        sigma = 1.2533 * 1.4826 * float(np.median(np.abs(ratios - median))) / np.sqrt(len(ratios))
        is_wrong = abs(median - 1.0) > max(self._max_error, _SIGNIFICANT * sigma)
        return median * focal_px if is_wrong else None
