# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of a calibration board through any lens, with known poses."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.camera import CameraModel
from cdff_common.geometry import se3
from cdff_core.calibration.boards import Board

#: Samples along each side of a pixel.
_SAMPLES = 3
_PIXELS_PER_M = 4000.0
_BACKGROUND = 90.0
#: Width of the white frame of a board, squares or tags.
_MARGIN = 0.6


def board_image(
    camera: CameraModel,
    board: Board,
    T_camera_board: FloatArray,
    rng: np.random.Generator,
    *,
    noise: float = 2.0,
    blur_px: float = 0.5,
) -> ByteArray:
    """Return the image of a board ``(rows, cols)``: 9 rays for each pixel, blur, light that falls off, noise.

    Parameters
    ----------
    T_camera_board : ndarray, shape (4, 4)
    noise : float
        Standard deviation, grey values.
    blur_px : float
        Standard deviation of the point spread function.
    """
    picture, origin_m = _picture(board)
    T_board_camera = se3.inverse(T_camera_board)
    with np.errstate(invalid="ignore", divide="ignore"):
        rays = _rays(camera) @ T_board_camera[:3, :3].T
        distances = -T_board_camera[2, 3] / rays[:, 2]
        hits = T_board_camera[:2, 3] + distances[:, None] * rays[:, :2]
        hits[~(distances > 0.0)] = np.nan
    at = np.nan_to_num((hits - origin_m) * _PIXELS_PER_M - 0.5, nan=-1e4, posinf=-1e4, neginf=-1e4)
    centres = np.clip(at, -1e4, 2e4).astype(np.float32).reshape(camera.rows, camera.cols, 2)
    # Positions on the board vary smoothly between the centres of pixels.
    size = (camera.cols * _SAMPLES, camera.rows * _SAMPLES)
    maps = cv2.resize(centres, size, interpolation=cv2.INTER_LINEAR)
    values = cv2.remap(
        picture,
        np.asarray(maps[..., 0]),
        np.asarray(maps[..., 1]),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=_BACKGROUND,
    )
    image = np.asarray(values).reshape(camera.rows, _SAMPLES, camera.cols, _SAMPLES).mean(axis=(1, 3))
    image = np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px)) if blur_px else image
    y, x = np.mgrid[-1 : 1 : camera.rows * 1j, -1 : 1 : camera.cols * 1j]
    image = image * (1.0 - 0.15 * (x**2 + y**2)) + rng.normal(0.0, noise, image.shape)
    return np.asarray(np.clip(np.rint(image), 0, 255), np.uint8)


def board_poses(
    board: Board, count: int, rng: np.random.Generator, *, distance_m: float, tilt_deg: float = 35.0
) -> Iterator[FloatArray]:
    """Yield ``T_camera_board`` (4, 4) of a board in front of the camera, shifted, tilted and turned."""
    centre = np.append(np.mean([board.corners_m.min(axis=0), board.corners_m.max(axis=0)], axis=0)[:2], 0.0)
    for _ in range(count):
        axis_angle = rng.uniform(-1.0, 1.0, 3) * np.deg2rad([tilt_deg, tilt_deg, 20.0])
        R = se3.exp_so3(axis_angle)
        z = distance_m * rng.uniform(0.8, 1.5)
        position = np.array([rng.uniform(-0.35, 0.35) * z, rng.uniform(-0.28, 0.28) * z, z])
        yield se3.transform(R, position - R @ centre)


@lru_cache(maxsize=2)
def _rays(camera: CameraModel) -> FloatArray:
    """Return the rays of all pixels ``(rows * cols, 3)``."""
    v, u = np.mgrid[: camera.rows, : camera.cols].reshape(2, -1)
    return camera.rays(np.column_stack([u, v]))


@lru_cache(maxsize=2)
def _picture(board: Board) -> tuple[NDArray[np.float32], FloatArray]:
    """Return the board with a white frame, and the position (m) of its upper left corner."""
    picture = board.picture(_PIXELS_PER_M).astype(np.float32)
    margin = round(_MARGIN * board.size_m * _PIXELS_PER_M)
    framed = np.pad(picture, margin, constant_values=255.0)
    origin = -margin / _PIXELS_PER_M - board.border_m
    return np.asarray(20.0 + framed * (200.0 / 255.0), np.float32), np.array([origin, origin])
