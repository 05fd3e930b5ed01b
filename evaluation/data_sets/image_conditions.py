# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Field conditions of recorded images: exposure, dust, glare, blur, own shadow and arm, faults of cameras.

Each condition is a function of a sequence of views and returns the disturbed sequence, in the same order. It
is applied alike to stereo pairs and to the colour images of an RGB-D camera.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import ByteArray, FloatArray

Float = NDArray[np.float64]
#: Grey levels added by saturation, and the factors of the exposures.
_OVER_EXPOSURE, _UNDER_EXPOSURE = 3.5, 0.06
#: Noise of a dark image after amplification, and of the condition ``noise``, DN.
_DARK_NOISE_DN, _NOISE_DN = 1.5, 25.0
#: Dust on a lens: number of spots, their radii as a ratio of the width, and the remaining light in them.
_SPOTS, _SPOT_RATIO, _SPOT_LIGHT = 14, (0.012, 0.05), 0.35
#: Length of the motion blur, and shift between the first and the last row by a rolling shutter, as ratios of
#: the width.
_BLUR_RATIO, _ROLLING_RATIO = 0.025, 0.012
#: Row offset of a right image, pixels, and ratio of a wrong focal length.
_ROW_OFFSET_PX, _FOCAL_RATIO = 2.0, 1.03


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Images of one time.

    Attributes
    ----------
    images : tuple of ndarray of uint8, shape (rows, columns) or (rows, columns, 3)
        Left and right image of a stereo camera, or the image of an RGB-D camera.
    camera_matrix : ndarray, shape (3, 3)
        As it is stated to the compound.
    stamp_ns : int
    index : int
        Number of the view in the recorded sequence.
    """

    images: tuple[ByteArray, ...]
    camera_matrix: FloatArray
    stamp_ns: int
    index: int


Condition = Callable[[Sequence[View]], list[View]]


def conditions() -> dict[str, Condition]:
    """Return the conditions of every camera by name, ``none`` first."""
    return {
        "none": list,
        "over-exposed": _each(lambda image, _: image * _OVER_EXPOSURE),
        "under-exposed": _each(
            lambda image, rng: image * _UNDER_EXPOSURE + rng.normal(0, _DARK_NOISE_DN, image.shape)
        ),
        "exposure changes": _exposure_changes,
        "dust on the lenses": _dust,
        "glare": _glare,
        "motion blur": _each(lambda image, _: _blurred(image)),
        "rolling shutter": _rolling_shutter,
        "own shadow and arm": _shadow_and_arm,
        "moving object": _moving_object,
        "noise": _each(lambda image, rng: image + rng.normal(0, _NOISE_DN, image.shape)),
        "two frames missing": lambda views: [v for k, v in enumerate(views) if k not in _middle(views, 2)],
        "black from the middle on": _black(0, 1),
        "focal length 3 % too long": _wrong_focal_length,
    }


def stereo_conditions() -> dict[str, Condition]:
    """Return the conditions of stereo cameras by name."""
    return {
        "right camera lost": _black(1),
        "left camera lost": _black(0),
        "cameras swapped": lambda views: [replace(v, images=v.images[::-1]) for v in views],
        "right image one frame late": _late,
        "right image two rows lower": _row_offset,
    }


def _each(change: Callable[[Float, np.random.Generator], Float]) -> Condition:
    """Return the condition that changes each image by itself."""

    def apply(views: Sequence[View]) -> list[View]:
        rng = np.random.default_rng(1)
        return [
            replace(v, images=tuple(_bytes(change(i.astype(np.float64), rng)) for i in v.images))
            for v in views
        ]

    return apply


def _bytes(image: Float) -> ByteArray:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _middle(views: Sequence[View], count: int) -> range:
    """Return the positions of some views in the middle of a sequence."""
    start = len(views) // 2
    return range(start, start + count)


def _multiplied(
    views: Sequence[View], factors: Callable[[int, tuple[int, int]], Float], offset: float = 0.0
) -> list[View]:
    """Return views whose images are multiplied by factors of the camera and added to them times an offset."""
    results = []
    for view in views:
        images = []
        for camera, image in enumerate(view.images):
            factor = factors(camera, image.shape[:2])
            factor = factor[..., None] if image.ndim == 3 else factor
            images.append(_bytes(image * factor + offset * (1.0 - factor)))
        results.append(replace(view, images=tuple(images)))
    return results


def _exposure_changes(views: Sequence[View]) -> list[View]:
    """Return the views; every second one has half of the light."""
    return [
        replace(v, images=tuple(_bytes(0.5 * i.astype(np.float64)) for i in v.images)) if k % 2 else v
        for k, v in enumerate(views)
    ]


def _dust(views: Sequence[View]) -> list[View]:
    """Return the views with blurred dark spots, which cover the same pixels in all views of a lens."""

    def factor(camera: int, shape: tuple[int, int]) -> Float:
        rng = np.random.default_rng([2, camera])
        mask = np.zeros(shape)
        for _ in range(_SPOTS):
            centre = (int(rng.integers(shape[1])), int(rng.integers(shape[0])))
            radius = max(2, int(rng.uniform(*_SPOT_RATIO) * shape[1]))
            cv2.circle(mask, centre, radius, 1.0, thickness=-1)
        blurred = cv2.GaussianBlur(mask, (0, 0), 0.008 * shape[1])
        return np.asarray(1.0 - (1.0 - _SPOT_LIGHT) * blurred)

    return _multiplied(views, factor, 40.0)


def _glare(views: Sequence[View]) -> list[View]:
    """Return the views with the glare of a Sun above the upper edge, further right in the right image."""

    def factor(camera: int, shape: tuple[int, int]) -> Float:
        rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
        centre = (0.35 + 0.06 * camera) * shape[1]
        distance = np.hypot(columns - centre, rows + 0.05 * shape[0]) / shape[1]
        return np.asarray(1.0 - np.clip(1.25 * np.exp(-distance / 0.22), 0.0, 1.0))

    return _multiplied(views, factor, 255.0)


def _blurred(image: Float) -> Float:
    length = max(3, round(_BLUR_RATIO * image.shape[1]))
    return np.asarray(cv2.filter2D(image, -1, np.full((1, length), 1.0 / length)))


def _rolling_shutter(views: Sequence[View]) -> list[View]:
    """Return the views of a rolling shutter on a vibrating mast.

    The rows of an image are shifted in proportion to their time; the amplitude differs between views.
    """
    results = []
    for k, view in enumerate(views):
        images = []
        for image in view.images:
            shift = _ROLLING_RATIO * image.shape[1] * np.cos(2.0 * k)
            warp = np.array([[1.0, shift / image.shape[0], -0.5 * shift], [0.0, 1.0, 0.0]])
            size = image.shape[1::-1]
            images.append(
                np.asarray(cv2.warpAffine(image, warp, size, borderMode=cv2.BORDER_REPLICATE), np.uint8)
            )
        results.append(replace(view, images=tuple(images)))
    return results


def _texture(shape: tuple[int, int], seed: int) -> Float:
    """Return grey levels (rows, columns) with structures of 3 to 12 pixels."""
    rng = np.random.default_rng(seed)
    total = sum(s * cv2.GaussianBlur(rng.normal(size=shape), (0, 0), s) for s in (1.5, 3.0, 6.0))
    return np.asarray(110.0 + 45.0 * (total - np.mean(total)) / np.std(total))


def _pasted(image: ByteArray, texture: Float, column: int, row: int) -> ByteArray:
    """Return an image with a texture whose upper left corner is at a pixel, cut off at the edges."""
    result = image.copy()
    rows, columns = image.shape[:2]
    top, left = max(row, 0), max(column, 0)
    bottom, right = min(row + texture.shape[0], rows), min(column + texture.shape[1], columns)
    if bottom > top and right > left:
        part = _bytes(texture[top - row : bottom - row, left - column : right - column])
        result[top:bottom, left:right] = part[..., None] if image.ndim == 3 else part
    return result


def _shadow_and_arm(views: Sequence[View]) -> list[View]:
    """Return the views with a shadow on their lower right, and an arm that covers a fifth of their width."""

    def factor(_camera: int, shape: tuple[int, int]) -> Float:
        rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
        in_shadow = rows / shape[0] + columns / shape[1] > 1.25
        return np.where(in_shadow, 0.3, 1.0)

    results = []
    for view in _multiplied(views, factor):
        images = []
        for camera, image in enumerate(view.images):
            rows, columns = image.shape[:2]
            texture = _texture((rows // 2, columns // 5), 3)
            disparity = round(0.08 * columns) * camera
            images.append(_pasted(image, texture, round(0.2 * columns) - disparity, rows - texture.shape[0]))
        results.append(replace(view, images=tuple(images)))
    return results


def _moving_object(views: Sequence[View]) -> list[View]:
    """Return the views with a textured object that crosses the image and covers a sixth of it."""
    results = []
    for k, view in enumerate(views):
        images = []
        for camera, image in enumerate(view.images):
            rows, columns = image.shape[:2]
            texture = _texture((rows // 2, columns // 3), 4)
            disparity = round(0.04 * columns) * camera
            column = round((0.05 + 0.03 * k) * columns) - disparity
            images.append(_pasted(image, texture, column, rows // 4))
        results.append(replace(view, images=tuple(images)))
    return results


def _black(*cameras: int) -> Condition:
    """Return the condition whose images of some cameras are black from the middle of the sequence on."""

    def apply(views: Sequence[View]) -> list[View]:
        first = len(views) // 2
        return [
            replace(v, images=tuple(np.zeros_like(i) if c in cameras else i for c, i in enumerate(v.images)))
            if k >= first
            else v
            for k, v in enumerate(views)
        ]

    return apply


def _wrong_focal_length(views: Sequence[View]) -> list[View]:
    scale = np.array([[_FOCAL_RATIO, 1.0, 1.0], [1.0, _FOCAL_RATIO, 1.0], [1.0, 1.0, 1.0]])
    return [replace(v, camera_matrix=v.camera_matrix * scale) for v in views]


def _late(views: Sequence[View]) -> list[View]:
    """Return the views, except the first, with the right image of the previous view."""
    return [replace(v, images=(v.images[0], previous.images[1])) for previous, v in pairwise(views)]


def _row_offset(views: Sequence[View]) -> list[View]:
    warp = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, _ROW_OFFSET_PX]])
    return [
        replace(
            v,
            images=(
                v.images[0],
                np.asarray(
                    cv2.warpAffine(
                        v.images[1], warp, v.images[1].shape[1::-1], borderMode=cv2.BORDER_REPLICATE
                    ),
                    np.uint8,
                ),
            ),
        )
        for v in views
    ]
