# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Folders of images as logs, with calibrations and true poses, if available."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cdff_common.camera import CameraModel, check_image_size, read_camera, read_depth_unit
from cdff_common.errors import InputError
from cdff_core.imaging.pair_rectifier import PAIR_TOLERANCE_NS
from cdff_dev.logs.file_stamps import file_stamps
from cdff_dev.logs.formats.images.attitude import given_attitude_stream
from cdff_dev.logs.formats.images.attitudes import attitude_stream
from cdff_dev.logs.formats.images.sequences import ImageSequence, image_sequences, sequences_of
from cdff_dev.logs.formats.images.stereo import (
    read_stereo_calibration,
    stereo_sequences,
    stereo_stream,
)
from cdff_dev.logs.formats.images.truth import truth_stream, truth_tables
from cdff_dev.logs.image_streams import IMAGE_SUFFIXES, Stamps, depth_stream, frame_stream, read_image
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted

ROBOT = "robot"
PAIR = f"/{ROBOT}/navcam.pair"
_CALIBRATION_SUFFIXES = (".yaml", ".yml", ".json", ".xml")


@dataclass(frozen=True, slots=True)
class _Calibration:
    """A camera and the unit of its depth values, metres, if stated; ``path`` is its file."""

    path: Path
    camera: CameraModel
    depth_unit_m: float | None


@dataclass(slots=True)
class _Content:
    """Streams of a folder, its content without a stream, and the files that are used."""

    streams: dict[str, IndexedStream] = field(default_factory=dict)
    unconverted: dict[str, Unconverted] = field(default_factory=dict)
    used: set[Path] = field(default_factory=set)


def folder_log(folder: Path, calibration: Path | None = None) -> IndexedLog:
    """Open the images of a folder and its sub-folders.

    Images whose names differ only in numbers are the stream ``/robot/{sensor}.frame``; ``sensor`` is the name
    of the sub-folder, or the common part of the names, or ``camera``. If two sequences are called left and
    right (as in ``stereo_pairs``) and a calibration has two cameras, their images are ``/robot/navcam.pair``.
    Depth images of 16 bits with a camera and a stated unit are ``/robot/{sensor}.depth``. Stamps are those of
    ``times.txt`` next to the images, else of their names (see ``file_stamps``), else 100 ms apart. The camera
    is ``calibration``; else, of the calibrations in the folder, its ``config`` or that of the images: the one
    after whose name the images are named, else the only one, or the only one of images with or without depth.
    The principal point of a ViSP configuration (XML) that is exactly half the size of the image is the middle
    of the image: measured from the centre of the first pixel, as in CDFF, it is half a pixel less.
    Tables of true poses are described in ``formats.images.truth``, and true attitudes in
    ``formats.images.attitudes``. All other files are listed as not converted.

    Raises
    ------
    InputError
        If a calibration that the user names cannot be read or does not fit, or ``times.txt`` or a table of
        true poses cannot be read.
    """
    content = _Content()
    sequences = image_sequences(folder)
    stamps = [_stamps(sequence, content.used) for sequence in sequences]
    in_pairs = _add_pairs(folder, sequences, stamps, calibration, content)
    for sequence, stamps_ns in zip(sequences, stamps, strict=True):
        if sequence in in_pairs:
            continue
        chosen = _calibration_of(sequence, folder, calibration, content)
        _add_stream(sequence, stamps_ns, chosen, content)
        content.used.update(sequence.files)
    first = next((i for i, s in enumerate(sequences) if not s.is_depth), 0)
    _add_truth(folder, sequences[first], stamps[first], content)
    if (path := folder / "attitude.csv").is_file():
        name, stream = given_attitude_stream(ROBOT, sequences[first].sensor, path)
        content.streams[name] = stream
        content.used.add(path)
    content.unconverted = (
        other_files(
            folder,
            lambda file: file in content.used or file.suffix.lower() in IMAGE_SUFFIXES,
            "not an image, a calibration of one, times.txt or a table of true poses",
        )
        | content.unconverted
    )
    return IndexedLog(content.streams, content.unconverted)


def files_log(files: Sequence[Path], calibration: Path | None = None) -> IndexedLog:
    """Open images that are named one by one or by a pattern, with the calibrations of their folder.

    Streams and stamps are those of ``folder_log``, but without ``times.txt``, true poses and pairs.
    """
    content = _Content()
    for sequence in sequences_of(files):
        chosen = _calibration_of(sequence, sequence.folder, calibration, content)
        _add_stream(sequence, file_stamps(sequence.files), chosen, content)
    return IndexedLog(content.streams, content.unconverted)


def _add_pairs(
    folder: Path,
    sequences: list[ImageSequence],
    stamps: list[Stamps],
    calibration: Path | None,
    content: _Content,
) -> tuple[ImageSequence, ...]:
    """Add the stream of stereo pairs, if the folder has them, and return the sequences of their images."""
    stereo_pair = stereo_sequences(sequences)
    if stereo_pair is None:
        return ()
    chosen = read_stereo_calibration(_calibration_files(folder, stereo_pair[0].folder), calibration)
    if chosen is None:
        return ()
    both = stamps[sequences.index(stereo_pair[0])], stamps[sequences.index(stereo_pair[1])]
    content.streams[PAIR], single = stereo_stream(PAIR, stereo_pair, both, *chosen)
    content.used.update((chosen[0], *stereo_pair[0].files, *stereo_pair[1].files))
    if single:
        reason = f"no image of the other camera within {PAIR_TOLERANCE_NS / 1e6:g} ms"
        content.unconverted["single images"] = Unconverted("image", single, reason)
    return stereo_pair


def _stamps(sequence: ImageSequence, used_files: set[Path]) -> Stamps:
    times = sequence.folder / "times.txt"
    if times.is_file():
        used_files.add(times)
        return file_stamps(sequence.files, times)
    return file_stamps(sequence.files)


def _calibration_of(
    sequence: ImageSequence, folder: Path, named: Path | None, content: _Content
) -> _Calibration | None:
    """Return the calibration of a sequence, or None; one that does not fit is listed as not converted."""
    calibration = _read(named) if named else _choose(sequence, _calibrations(folder, sequence.folder))
    if calibration is None:
        return None
    rows, cols = read_image(sequence.files[0]).shape[:2]
    content.used.add(calibration.path)
    try:
        check_image_size(calibration.camera, rows, cols, str(calibration.path))
    except InputError as error:
        if named:
            raise
        content.unconverted[calibration.path.name] = Unconverted("calibration", 1, str(error))
        return None
    if calibration.path.suffix.lower() == ".xml" and (
        calibration.camera.cx,
        calibration.camera.cy,
    ) == (cols / 2, rows / 2):
        # ViSP's configurations of rendered images state the middle of the image, from its corner.
        camera = dataclasses.replace(
            calibration.camera,
            cx=calibration.camera.cx - 0.5,
            cy=calibration.camera.cy - 0.5,
        )
        return dataclasses.replace(calibration, camera=camera)
    return calibration


def _read(path: Path) -> _Calibration:
    return _Calibration(path, read_camera(path), read_depth_unit(path))


def _calibration_files(folder: Path, images: Path) -> list[Path]:
    """Return possible calibrations in the folder, its ``config`` and the folder of the images."""
    places = dict.fromkeys((folder, folder / "config", images))
    files = [path for place in places if place.is_dir() for path in sorted(place.iterdir())]
    return [path for path in files if path.suffix.lower() in _CALIBRATION_SUFFIXES and path.is_file()]


def _calibrations(folder: Path, images: Path) -> list[_Calibration]:
    """Return the calibrations for the images of a folder."""
    readable = []
    for path in _calibration_files(folder, images):
        try:
            readable.append(_read(path))
        except InputError:  # not a calibration: listed with the other files
            continue
    return readable


def _choose(sequence: ImageSequence, candidates: list[_Calibration]) -> _Calibration | None:
    by_name = [c for c in candidates if sequence.pattern.startswith(c.path.stem)]
    by_kind = [c for c in candidates if ("depth" in c.path.stem) == sequence.is_depth]
    return next((chosen[0] for chosen in (by_name, by_kind, candidates) if len(chosen) == 1), None)


def _add_stream(
    sequence: ImageSequence, stamps_ns: Stamps, chosen: _Calibration | None, content: _Content
) -> None:
    """Add the stream of an image sequence; depth images without a known unit stay images, with a reason."""
    camera = None if chosen is None else chosen.camera
    is_depth = sequence.is_depth and read_image(sequence.files[0]).dtype == np.uint16
    if is_depth and (chosen is None or chosen.depth_unit_m is None):
        missing = "no calibration" if chosen is None else f"no depthScale in {chosen.path.name}"
        reason = f"{missing}: they are images; expected --calibration FILE with depthScale, metres"
        content.unconverted[f"distances of {sequence.sensor}"] = Unconverted(
            "image", len(sequence.files), reason
        )
    if is_depth and chosen is not None and chosen.depth_unit_m is not None:
        name = f"/{ROBOT}/{sequence.sensor}.depth"
        content.streams[name] = depth_stream(
            name, sequence.files, stamps_ns, chosen.camera, chosen.depth_unit_m
        )
    else:
        name = f"/{ROBOT}/{sequence.sensor}.frame"
        content.streams[name] = frame_stream(name, sequence.files, stamps_ns, camera)


def _add_truth(folder: Path, sequence: ImageSequence, stamps_ns: Stamps, content: _Content) -> None:
    """Add true poses and attitudes of the camera with a sequence; their other content is listed."""
    for path in truth_tables(folder):
        truth = truth_stream(ROBOT, folder, path, sequence, stamps_ns)
        content.streams[truth.name] = truth.stream
        content.used.add(path)
        if truth.without_image:
            content.unconverted[path.name] = Unconverted("pose", truth.without_image, "without an image")
        if truth.other_columns:
            columns = f"{path.name}: {', '.join(truth.other_columns)}"
            content.unconverted[columns] = Unconverted("row", truth.rows, "no part of a pose")
    for path in sorted(folder.glob("*.json")):
        attitudes = None if path in content.used else attitude_stream(ROBOT, path, sequence, stamps_ns)
        if attitudes is not None:
            name, content.streams[name], others = attitudes
            content.used.add(path)
            if others:
                fields = f"{path.name}: {', '.join(others)}"
                content.unconverted[fields] = Unconverted(
                    "entry", attitudes[1].info.count, "no part of an attitude"
                )
