# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth images: their depths and camera, points of a part of them, and their pairs with colour images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import DistanceImage

#: Largest difference between the times of an image and its depth image.
MAX_GAP_NS = 20_000_000


class RgbdSamples(NamedTuple):
    """An image and the depth image of its time; one of them may be missing."""

    image: Sample | None
    depth: Sample | None

    @property
    def newest(self) -> Sample:
        """The image, or the depth image without one."""
        sample = self.image or self.depth
        assert sample is not None
        return sample


class RgbdPairing:
    """Combines the samples of ports ``image`` and ``depth`` whose times differ by at most 20 ms.

    A sample waits for the other one only if the other port had one since the last sample of its own port: a
    stream that is alone does not wait.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Remove the sample that waits."""
        self._waiting: Sample | None = None
        self._expected = {"image": True, "depth": False}

    def add(self, sample: Sample) -> list[RgbdSamples]:
        """Return the complete pairs, and samples whose pair will not be completed, oldest first."""
        other, self._waiting = self._waiting, None
        pairs: list[RgbdSamples] = []
        self._expected[sample.port] = True
        if other is not None:
            if other.port != sample.port and abs(other.stamp_ns - sample.stamp_ns) <= MAX_GAP_NS:
                return [_pair(other, sample)]
            pairs.append(_pair(other))
            if other.port == sample.port:
                self._expected[_OTHER[sample.port]] = False
        if self._expected[_OTHER[sample.port]]:
            self._waiting = sample
            return pairs
        return [*pairs, _pair(sample)]

    def take_waiting(self) -> list[RgbdSamples]:
        """Return the sample that still waits, and remove it."""
        waiting, self._waiting = self._waiting, None
        return [] if waiting is None else [_pair(waiting)]


_OTHER = {"image": "depth", "depth": "image"}


def _pair(*samples: Sample) -> RgbdSamples:
    by_port = {sample.port: sample for sample in samples}
    return RgbdSamples(by_port.get("image"), by_port.get("depth"))


def depth_of(image: DistanceImage, min_m: float, max_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the depths ``(rows, columns)``, NaN outside the limits, and the camera matrix.

    Raises
    ------
    InputError
        If the number of distances or the scale is wrong.
    """
    if len(image.data) != image.width * image.height or not (image.scale_x > 0 and image.scale_y > 0):
        raise InputError(
            f"distance image of {image.width} x {image.height} with {len(image.data)} distances, scale "
            f"{image.scale_x:g}, {image.scale_y:g}: expected one per pixel and a scale above 0"
        )
    z = image.data.reshape(image.height, image.width).astype(np.float64)
    fx, fy = 1.0 / image.scale_x, 1.0 / image.scale_y
    K = np.array([[fx, 0.0, -image.center_x * fx], [0.0, fy, -image.center_y * fy], [0.0, 0.0, 1.0]])
    with np.errstate(invalid="ignore"):
        return np.where((z > 0.0) & (z >= min_m) & (z <= max_m), z, np.nan), K


def points_near(
    image: DistanceImage, centre_m: FloatArray, radius_m: float, max_points: int
) -> tuple[FloatArray, int]:
    """Return at most about ``max_points`` points (n, 3) of a depth image in a ball, on a grid of its pixels.

    The second result is the step of this grid, pixels.

    Parameters
    ----------
    centre_m : ndarray, shape (3,)
        Centre of the ball in the frame of the depth camera: x right, y down, z forward.
    radius_m : float

    Raises
    ------
    InputError
        If the number of distances or the scale is wrong.
    """
    depth_m, K = depth_of(image, 0.0, np.inf)
    rows, columns = depth_m.shape
    nearest_m = centre_m[2] - radius_m
    low, high = np.zeros(2), np.array([columns, rows], np.float64)
    if nearest_m > 0.0:
        focal, middle = np.array([K[0, 0], K[1, 1]]), K[:2, 2]
        # Tangents of the ball: those of its centre, and its radius over its nearest depth.
        tangent = centre_m[:2] / centre_m[2]
        reach = radius_m / nearest_m * (1.0 + np.abs(tangent))
        low = np.clip(np.floor(middle + focal * (tangent - reach)), 0, high)
        high = np.clip(np.ceil(middle + focal * (tangent + reach)) + 1, 0, high)
    (c0, r0), (c1, r1) = low.astype(int), high.astype(int)
    part = depth_m[r0:r1, c0:c1]
    v, u = np.mgrid[r0:r1, c0:c1]
    xy = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]], axis=-1)
    points = np.concatenate([xy, np.ones((*part.shape, 1))], axis=-1) * part[..., None]
    with np.errstate(invalid="ignore"):
        is_near = np.linalg.norm(points - centre_m, axis=-1) < radius_m
    step = max(1, int(np.ceil(np.sqrt(np.count_nonzero(is_near) / max(max_points, 1)))))
    return np.ascontiguousarray(points[::step, ::step][is_near[::step, ::step]]), step
