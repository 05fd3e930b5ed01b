# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Masks of the pixels of a camera that always show the robot, for example an arm or the deck."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.errors import ConfigurationError, InputError


def decode_mask(png_base64: str, camera: str) -> BoolArray:
    """Return the usable pixels (rows, cols) of a mask image, whose black pixels (0) show the robot.

    Parameters
    ----------
    png_base64 : str
        An image file in base64, as ``Sensor.mask`` in a loaded profile.
    camera : str
        Name of the camera, for error messages.

    Raises
    ------
    ConfigurationError
        If the text is not an image in base64.
    """
    try:
        data = np.frombuffer(base64.b64decode(png_base64, validate=True), np.uint8)
    except binascii.Error as error:
        raise ConfigurationError(f"mask of {camera}: {error}, expected a PNG in base64") from error
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if image is None:
        raise ConfigurationError(f"mask of {camera}: {len(data)} bytes, expected an image such as a PNG")
    return np.asarray(image > 0)


def eroded(mask: BoolArray, margin_px: int) -> BoolArray:
    """Return a mask (rows, cols) of the pixels whose square neighbourhood is usable.

    The half width of the square is ``margin_px``; pixels outside the image count as usable.
    """
    kernel = np.ones((2 * margin_px + 1, 2 * margin_px + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), kernel) > 0)


def at_pixels(mask: BoolArray | None, pixels: FloatArray) -> BoolArray:
    """Return the values (n,) of a mask at columns and rows ``(n, 2)``, rounded; all true without a mask."""
    if mask is None:
        return np.ones(len(pixels), bool)
    rows, columns = mask.shape
    nearest: IntArray = np.rint(pixels).astype(np.int64)
    return np.asarray(mask[np.clip(nearest[:, 1], 0, rows - 1), np.clip(nearest[:, 0], 0, columns - 1)])


def check_size(mask: BoolArray | None, image: Any, camera: str) -> None:
    """Raise InputError if the size of a mask differs from that of the image of its camera."""
    if mask is not None and mask.shape != image.shape[:2]:
        raise InputError(f"mask of {camera}: {mask.shape}, expected the size of the image {image.shape[:2]}")


def camera_entry(sensors: Mapping[str, Mapping[str, Any]], frame: str) -> Mapping[str, Any]:
    """Return the entry of the stereo camera with a frame id among the sensors of a profile.

    A single stereo camera matches any frame. The result is empty if no stereo camera matches; raises
    InputError if one of several has a mask then.
    """
    cameras = [entry for entry in sensors.values() if entry.get("kind") == "stereo_camera"]
    entries_of_frame = [entry for entry in cameras if entry.get("frame") == frame]
    if entries_of_frame or len(cameras) == 1:
        return (entries_of_frame or cameras)[0]
    if any(entry.get("mask") or entry.get("mask_right") for entry in cameras):
        known_frames = ", ".join(str(entry.get("frame")) for entry in cameras)
        raise InputError(f"image of frame {frame!r}: expected one of the cameras with a mask, {known_frames}")
    return {}
