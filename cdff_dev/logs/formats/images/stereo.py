# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo pairs in a folder of images: sequences called left and right, with a calibration of both cameras."""

from __future__ import annotations

from pathlib import Path

from cdff_common.camera import StereoCalibration, check_image_size, read_stereo
from cdff_common.errors import InputError
from cdff_dev.logs.formats.images.sequences import ImageSequence
from cdff_dev.logs.image_streams import Stamps, pair_stream, read_image
from cdff_dev.logs.indexed import IndexedStream
from cdff_dev.logs.stereo_pairs import counterpart, matched_stamps


def stereo_sequences(sequences: list[ImageSequence]) -> tuple[ImageSequence, ImageSequence] | None:
    """Return the left and right sequence of a folder by their names; None without, or with several."""
    by_name = {sequence.sensor: sequence for sequence in sequences if not sequence.is_depth}
    stereo_pairs = [
        (left, by_name[names[0]])
        for name, left in by_name.items()
        if (names := counterpart(name)) is not None and names[0] in by_name
    ]
    return stereo_pairs[0] if len(stereo_pairs) == 1 else None


def read_stereo_calibration(
    candidates: list[Path], named: Path | None
) -> tuple[Path, StereoCalibration] | None:
    """Return the file that the user names, or else the only one with two cameras; None unless there is
    exactly one.

    If the user names a file with only one camera, the result is None too.
    """
    calibrations = []
    for path in [named] if named else candidates:
        try:
            calibrations.append((path, read_stereo(path)))
        except InputError:  # not a calibration of two cameras: used for single images, or listed
            continue
    return calibrations[0] if len(calibrations) == 1 else None


def stereo_stream(
    name: str,
    sequences: tuple[ImageSequence, ImageSequence],
    stamps: tuple[Stamps, Stamps],
    path: Path,
    stereo: StereoCalibration,
) -> tuple[IndexedStream, int]:
    """Return the stream of the pairs with the stamps of the left images, and the number of single images.

    Raises
    ------
    InputError
        If no images have equal times, or the calibration at ``path`` does not fit them.
    """
    left, right = sequences
    pairs = matched_stamps(*stamps)
    if not len(pairs):
        raise InputError(f"{left.folder} and {right.folder}: no images of the same time")
    rows, cols = read_image(left.files[0]).shape[:2]
    check_image_size(stereo.left, rows, cols, str(path))
    files = [(left.files[i], right.files[j]) for i, j in pairs]
    single = len(left.files) + len(right.files) - 2 * len(pairs)
    return pair_stream(name, files, stamps[0][pairs[:, 0]], stereo), single
