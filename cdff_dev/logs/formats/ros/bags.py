# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files and folders of ROS 1 and ROS 2 bags, and MCAP files, by the recording to which they belong."""

from __future__ import annotations

import logging
import re
import tempfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import yaml
import zstandard

from cdff_common.errors import CodecError
from cdff_dev.logs.file_stamps import natural_order
from cdff_dev.logs.formats.ros import mcap_records
from cdff_dev.logs.formats.ros.bag1_file import Bag1Recording
from cdff_dev.logs.formats.ros.bag1_records import MAGIC
from cdff_dev.logs.formats.ros.bag2_database import Bag2Database
from cdff_dev.logs.formats.ros.mcap_file import McapRecording
from cdff_dev.logs.formats.ros.recording import PARSER_ERRORS, Channel, Encoded, JoinedRecording, Recording
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted

_log = logging.getLogger(__name__)
METADATA = "metadata.yaml"
_BAG2_SUFFIXES = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
_SUFFIXES = (*_BAG2_SUFFIXES, ".bag")
_NUMBERS = re.compile(r"\d+")
#: Largest ratio of the decompressed to the compressed size of a file; with a larger one it is refused as
#: damaged.
_MAX_RATIO = 1000


def open_folder(folder: Path) -> dict[str, Recording]:
    """Open the ROS 2 bag of a folder, or its bags and MCAP files as ``open_files``.

    Without ``metadata.yaml``, files of which one is the database of a ROS 2 bag are one recording, if their
    names differ only in numbers. Other files of the folder are listed with the first recording.

    Raises
    ------
    CodecError
        If no file can be read.
    """
    files = sorted((path for path in folder.iterdir() if path.name.endswith(_SUFFIXES)), key=natural_order)
    recordings = _recordings_of(folder, files)
    used_files = {*files, folder / METADATA}
    if others := other_files(folder, used_files.__contains__, "not a file of a bag"):
        name, first = next(iter(recordings.items()))
        recordings[name] = JoinedRecording(first.name, [first], others)
    return recordings


def _recordings_of(folder: Path, bag_files: list[Path]) -> dict[str, Recording]:
    if (folder / METADATA).is_file():
        return {str(folder): _open_bag2(folder, bag_files)}
    groups = _by_recording(bag_files)
    if len(groups) == 1 and bag_files[0].name.endswith((".db3", ".zstd")):
        return {str(folder): _open_bag2(folder, bag_files)}
    return _recordings(groups, str(folder))


def open_files(files: Sequence[Path]) -> dict[str, Recording]:
    """Open files by their content; those whose names differ only in numbers are parts of one recording.

    Returns
    -------
    dict
        Recordings by the name of their first file.

    Raises
    ------
    CodecError
        If no file can be read.
    """
    return _recordings(_by_recording(files), str(files[0]))


def _by_recording(files: Sequence[Path]) -> list[list[Path]]:
    """Return the files of each recording: a recorder that splits one numbers its files."""
    groups: dict[str, list[Path]] = defaultdict(list)
    for path in files:
        groups[_NUMBERS.sub("#", path.name)].append(path)
    return list(groups.values())


def _recordings(groups: Sequence[Sequence[Path]], name: str) -> dict[str, Recording]:
    """Open recordings; one that cannot be read is listed with another that can."""
    recordings: dict[str, Recording] = {}
    missing: dict[str, Unconverted] = {}
    for files in groups:
        openers = [
            (path, partial(_open_compressed if path.suffix == ".zstd" else _open, path, "")) for path in files
        ]
        try:
            recordings[str(files[0])] = _joined(name if len(groups) == 1 else str(files[0]), openers, {})
        except CodecError as error:
            if len(groups) == 1:
                raise
            _log.warning("%s", error)
            missing[files[0].name] = Unconverted("damaged part", 1, str(error))
    if not recordings:
        reasons = "; ".join(item.reason for item in missing.values())
        raise CodecError(f"{name}: no readable bag: {reasons or 'no .db3, .mcap or .bag file'}")
    if missing:
        first, recording = next(iter(recordings.items()))
        recordings[first] = JoinedRecording(first, [recording], missing)
    return recordings


def _open_bag2(folder: Path, bag_files: Sequence[Path]) -> Recording:
    """Open a ROS 2 bag; without metadata, its files are those of the folder."""
    missing: dict[str, Unconverted] = {}
    information = _metadata(folder / METADATA, missing)
    mode = str(information.get("compression_mode") or "").lower()
    named = [folder / PurePath(str(path)).name for path in information.get("relative_file_paths") or ()]
    parts = named or [path for path in bag_files if path.name.endswith(_BAG2_SUFFIXES)]
    for path in bag_files:
        if path not in parts:
            missing[path.name] = Unconverted("file", 1, f"not in the list of {METADATA}")
    openers = [
        (path, partial(_open_compressed if path.suffix == ".zstd" else _open, path, mode)) for path in parts
    ]
    return _joined(str(folder), openers, missing)


def _metadata(path: Path, missing: dict[str, Unconverted]) -> Mapping[str, Any]:
    """Return the information about a bag; none if the recording was not completed or it is damaged."""
    if not path.is_file():
        reason = "missing, the recorder was ended"
        _log.warning("%s: %s; the files of the folder are read", path, reason)
        missing[path.name] = Unconverted("damaged part", 1, f"{reason}; the files of the folder are read")
        return {}
    try:
        information = yaml.load(path.read_bytes(), yaml.CSafeLoader)["rosbag2_bagfile_information"]
        if isinstance(information, dict) and isinstance(information.get("relative_file_paths"), list):
            return information
        reason = "no list relative_file_paths"
    except (yaml.YAMLError, *PARSER_ERRORS) as error:
        reason = " ".join(str(error).split())[:200]
    _log.warning("%s: %s; the files of the folder are read", path, reason)
    missing[path.name] = Unconverted("damaged part", 1, f"{reason}; the files of the folder are read")
    return {}


def _joined(
    name: str, openers: Sequence[tuple[Path, Callable[[], Recording]]], missing: dict[str, Unconverted]
) -> Recording:
    """Open files; those that cannot be read are listed if others can."""
    parts: list[Recording] = []
    errors: list[Exception] = []
    for path, opener in openers:
        try:
            parts.append(opener())
        except (CodecError, OSError) as error:
            errors.append(error)
            missing[path.name] = Unconverted("damaged part", 1, str(error))
    if not parts:
        reasons = "; ".join(str(reason) for reason in errors)
        raise CodecError(f"{name}: no readable bag: {reasons or 'no .db3, .mcap or .bag file'}")
    for reason in errors:
        _log.warning("%s", reason)
    is_alone = [part.name for part in parts] == [name] and not missing
    return parts[0] if is_alone else JoinedRecording(name, parts, missing)


def _open(path: Path, compression_mode: str = "") -> Recording:
    """Open a file by its content."""
    with path.open("rb") as file:
        head = file.read(len(MAGIC))
    if head.startswith(mcap_records.MAGIC[:5]):
        return McapRecording(path)
    if head.startswith(MAGIC[:7]):
        return Bag1Recording(path)
    return Bag2Database(path, compression_mode == "message")


def _open_compressed(path: Path, _: str) -> Recording:
    return _Decompressed(path, _MAX_RATIO * path.stat().st_size)


class _Decompressed(JoinedRecording):
    """The copy of a file that the recorder has compressed, which is removed when it is closed."""

    def __init__(self, path: Path, limit: int) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="cdff_bag_")
        copy = Path(self._folder.name) / path.stem
        missing: dict[str, Unconverted] = {}
        try:
            with path.open("rb") as source, copy.open("wb") as target:
                reader = zstandard.ZstdDecompressor().stream_reader(source)
                while block := reader.read(1 << 20):
                    if target.tell() > limit:
                        raise ValueError(f"more than {limit} bytes after decompression")
                    target.write(block)
        except (zstandard.ZstdError, ValueError) as error:
            _log.warning("%s: %s; the part before is read", path, error)
            missing[path.name] = Unconverted("damaged part", 1, f"{error}; the part before is read")
        try:
            super().__init__(str(path), [_open(copy, "")], missing)
        except CodecError as error:
            self._folder.cleanup()
            raise CodecError(f"{path}: {error}") from error

    def decode(self, channel: Channel, raw: Encoded) -> Any:
        """Return a message; raises CodecError if it is damaged."""
        try:
            return super().decode(channel, raw)
        except CodecError as error:
            raise CodecError(f"{self.name}: {error}") from error

    def close(self) -> None:
        """Close and remove the copy."""
        super().close()
        self._folder.cleanup()
