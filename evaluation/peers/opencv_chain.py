# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chain of poses by OpenCV: SIFT, depths, ``solvePnPRansac`` from each image to the next."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3

Image = NDArray[np.uint8]
#: Largest ratio of the distances of the two nearest descriptors, and largest reprojection error, pixels.
_RATIO, _MAX_ERROR_PX = 0.8, 2.0
_MIN_INLIERS = 15


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """Result of a chain.

    Attributes
    ----------
    poses : ndarray, shape (n, 4, 4)
        ``T_first_current``; NaN after the first image that was not located.
    cpu_s : float
        CPU seconds per image.
    """

    poses: FloatArray
    cpu_s: float


def chain(
    images: Sequence[Image], depths: Sequence[Callable[[Image, FloatArray], FloatArray]], K: FloatArray
) -> Chain:
    """Return the chain of images without lens distortion.

    Parameters
    ----------
    depths : sequence of callable
        For each image: the depths (n,) of pixels (n, 2), metres, NaN where unknown.
    K : ndarray, shape (3, 3)
    """
    cv2.setRNGSeed(0)
    sift, matcher = cv2.SIFT.create(1500, contrastThreshold=0.01), cv2.BFMatcher()
    poses, previous = [np.eye(4)], None
    started = time.process_time()
    for image, depth in zip(images, depths, strict=True):
        keypoints, descriptors = sift.detectAndCompute(image, None)
        pixels = np.array([k.pt for k in keypoints])
        rooted = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9))
        z = depth(image, pixels)
        points = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(K).T * z[:, None]
        if previous is not None:
            poses.append(poses[-1] @ _motion(matcher, previous, (rooted, pixels), K))
        previous = (rooted[np.isfinite(z)], points[np.isfinite(z)])
    return Chain(np.array(poses), (time.process_time() - started) / len(images))


def disparity_depth(right: Image, focal_px: float, baseline_m: float) -> Callable[[Image, FloatArray], Any]:
    """Return the function of the depths of pixels of a left image by OpenCV's block matching."""

    def depths(left: Image, pixels: FloatArray) -> FloatArray:
        matcher = cv2.StereoSGBM.create(0, 128, 5, 200, 800, 1, 63, 10, 100, 2)
        disparity = matcher.compute(left, right) / 16.0
        columns, rows = np.rint(pixels).astype(int).T
        d = disparity[np.clip(rows, 0, len(left) - 1), np.clip(columns, 0, left.shape[1] - 1)]
        return np.asarray(np.where(d > 1.0, focal_px * baseline_m / np.maximum(d, 1e-9), np.nan))

    return depths


def image_depth(depth_m: NDArray[np.float32]) -> Callable[[Image, FloatArray], Any]:
    """Return the function of the depths of pixels by a registered depth image."""

    def depths(_: Image, pixels: FloatArray) -> FloatArray:
        columns, rows = np.rint(pixels).astype(int).T
        z = depth_m[np.clip(rows, 0, len(depth_m) - 1), np.clip(columns, 0, depth_m.shape[1] - 1)]
        return np.where(z > 0.1, z, np.nan).astype(np.float64)

    return depths


def _motion(
    matcher: Any, previous: tuple[Any, FloatArray], current: tuple[Any, FloatArray], K: FloatArray
) -> FloatArray:
    """Return T_previous_current; NaN without enough inliers."""
    pairs = matcher.knnMatch(previous[0].astype(np.float32), current[0].astype(np.float32), k=2)
    good = [m for m, n in pairs if m.distance < _RATIO * n.distance]
    unknown = np.full((4, 4), np.nan)
    if len(good) < _MIN_INLIERS:
        return unknown
    points = previous[1][[m.queryIdx for m in good]]
    pixels = current[1][[m.trainIdx for m in good]]
    is_found, r, t, inliers = cv2.solvePnPRansac(
        points, pixels, K, None, iterationsCount=500, reprojectionError=_MAX_ERROR_PX
    )
    if not is_found or inliers is None or len(inliers) < _MIN_INLIERS:
        return unknown
    rows = inliers[:, 0]
    r, t = cv2.solvePnPRefineLM(points[rows], pixels[rows], K, None, r, t)
    return se3.inverse(se3.transform(se3.exp_so3(r[:, 0]), t[:, 0]))
