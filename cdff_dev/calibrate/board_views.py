# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Corners of a board in the images of a log or folder, of one or two cameras."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import ByteArray
from cdff_common.errors import InputError
from cdff_common.progress import Progress
from cdff_common.types import Frame
from cdff_core.calibration.adjustment import View
from cdff_core.calibration.boards import Board
from cdff_core.imaging.grey import grey_image
from cdff_dev.logs.source import LogSource

#: Largest difference of the stamps of two images of a pair.
_PAIR_NS = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class BoardViews:
    """Views of a board, the sizes ``(rows, cols)`` of the images by camera, and the number of images."""

    views: list[View]
    sizes: list[tuple[int, int]]
    images: int


def board_views(log: LogSource, board: Board, cameras: int, streams: list[str]) -> BoardViews:
    """Return the views of a board.

    Parameters
    ----------
    cameras : int
        1 or 2; of two, images with equal stamps have one pose of the board.
    streams : list of str
        Streams of images, one for each camera, or a stream of stereo pairs; by default the only ones.

    Raises
    ------
    InputError
        If the streams are not there, or the size of the images changes.
    """
    names = streams or _default_streams(log, cameras)
    views: list[View] = []
    sizes: dict[int, tuple[int, int]] = {}
    total = sum(log.streams[name].count for name in names)
    progress, images = Progress(total, "images"), 0
    for camera, group, image in _images(log, names, cameras):
        images += 1
        if sizes.setdefault(camera, image.shape) != image.shape:
            raise InputError(
                f"camera {camera}: images of {sizes[camera]} and {image.shape} pixels, expected one size"
            )
        numbers, pixels = board.detect(image)
        if len(numbers):
            views.append(View(camera, group, board.corners_m[numbers], pixels, numbers))
        progress.advance()
    progress.close()
    if sorted(sizes) != list(range(cameras)):
        raise InputError(f"{', '.join(names)}: no images, expected those of {cameras} cameras")
    return BoardViews(views, [sizes[k] for k in range(cameras)], images)


def _default_streams(log: LogSource, cameras: int) -> list[str]:
    """Return the streams of images of a log; raises InputError if they are not unique."""
    pairs = [n for n, info in log.streams.items() if info.type_name == "FramePair" and info.count]
    if cameras == 2 and len(pairs) == 1:
        return pairs
    frames = sorted(n for n, info in log.streams.items() if info.type_name == "Frame" and info.count)
    if len(frames) != cameras:
        listed = ", ".join(frames + pairs) or "none"
        raise InputError(f"streams of images: {listed}; expected {cameras}, choose with --stream")
    return frames


def _images(log: LogSource, names: list[str], cameras: int) -> Iterator[tuple[int, int, ByteArray]]:
    """Yield the camera, the number of the board's pose and the grey image."""
    if cameras == 2 and len(names) == 1:
        for k, sample in enumerate(log.samples(names)):
            yield 0, k, grey_of_frame(sample.value.left)
            yield 1, k, grey_of_frame(sample.value.right)
        return
    stamps: list[int] = []
    for camera, name in enumerate(names):
        for sample in log.samples([name]):
            stamp_ns = sample.stamp_ns
            nearest = int(np.abs(np.array(stamps, np.int64) - stamp_ns).argmin()) if stamps else 0
            if camera and stamps and abs(stamps[nearest] - stamp_ns) <= _PAIR_NS:
                yield camera, nearest, grey_of_frame(sample.value)
                continue
            stamps.append(stamp_ns)
            yield camera, len(stamps) - 1, grey_of_frame(sample.value)


def grey_of_frame(frame: Frame) -> ByteArray:
    """Return a grey image ``(rows, cols)``; deeper images are scaled by their 99.9 % percentile."""
    image = frame.image
    if image.dtype == np.uint8:
        return np.ascontiguousarray(grey_image(frame))
    values = image.astype(np.float64).mean(axis=2) if image.ndim == 3 else image.astype(np.float64)
    white = max(float(np.percentile(values, 99.9)), 1e-12)
    return np.clip(np.rint(values * (255.0 / white)), 0, 255).astype(np.uint8)
