# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Formats of logs: one folder each, whose package has a constant ``FORMAT``."""

from __future__ import annotations

import glob
import pkgutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Self

from cdff_common.errors import CodecError, InputError

if TYPE_CHECKING:
    from cdff_dev.logs.source import LogSource


@dataclass(frozen=True, slots=True)
class LogLocation:
    """Files of a log.

    Attributes
    ----------
    name : str
        The argument of the user: a file, a folder or a pattern.
    folder : Path or None
        The folder, if it is one.
    files : tuple of Path
        The file, or the files that match the pattern; empty for a folder.
    """

    name: str
    folder: Path | None
    files: tuple[Path, ...]

    @classmethod
    def of(cls, path: str | Path) -> Self:
        """Return the location of a path or pattern; it has neither folder nor files if nothing matches."""
        location_path = Path(path)
        if location_path.is_dir():
            return cls(str(path), location_path, ())
        if location_path.is_file() or not any(c in str(path) for c in "*?["):
            return cls(str(path), None, (location_path,) if location_path.is_file() else ())
        return cls(str(path), None, tuple(Path(p) for p in sorted(glob.glob(str(path)))))  # noqa: PTH207

    def head(self, count: int) -> bytes:
        """Return the first bytes of the first file, or no bytes without a file."""
        if not self.files:
            return b""
        with self.files[0].open("rb") as file:
            return file.read(count)


@dataclass(frozen=True, slots=True)
class LogFormat:
    """A format of logs.

    Attributes
    ----------
    name : str
        Name for messages, such as "ROS 1 bag".
    files : str
        Files of this format, for the help of the command line.
    recognises : callable
        Whether the content at a location has this format.
    open : callable
        Opens the log, with the calibration of its cameras or None.
    takes_calibration : bool
        Whether the cameras of such a log need or accept a calibration file.
    is_generic : bool
        Whether it recognises any file of some types: such formats are asked after those of a layout.
    """

    name: str
    files: str
    recognises: Callable[[LogLocation], bool]
    open: Callable[[LogLocation, Path | None], LogSource]
    takes_calibration: bool = False
    is_generic: bool = False


@cache
def log_formats() -> tuple[LogFormat, ...]:
    """Return all formats by name, generic ones last."""
    names = [module.name for module in pkgutil.iter_modules(__path__) if module.ispkg]
    formats = [import_module(f"{__name__}.{name}").FORMAT for name in names]
    return tuple(sorted(formats, key=lambda f: (f.is_generic, f.name)))


def open_log(path: str | Path, calibration: Path | None = None) -> LogSource:
    """Open a log of any format.

    Parameters
    ----------
    path : str or Path
        A file, a folder, or a pattern such as ``run_*.msg``; ``cdff log --help`` lists the formats. If a
        folder is not a log itself, its only sub-folder that is one.
    calibration : Path, optional
        Calibration of the cameras, for formats without one.

    Raises
    ------
    InputError
        If no file matches, no format recognises it, or a calibration is given for a log that has its own.
    """
    location = LogLocation.of(path)
    if (chosen := _format_of(location)) is None:
        known = [(inner, found) for inner in _sub_folders(location) if (found := _format_of(inner))]
        if len(known) != 1:
            raise InputError(_reason_for_no_log(location, [inner.name for inner, _ in known]))
        location, chosen = known[0]
    if calibration is not None and not chosen.takes_calibration:
        raise InputError(
            f"log {path}: its format ({chosen.name}) contains its own cameras; expected no calibration"
        )
    try:
        return chosen.open(location, calibration)
    except InputError as error:
        if location.name in str(error):
            raise
        kind = CodecError if isinstance(error, CodecError) else InputError
        raise kind(f"log {location.name}: {error}") from error


def is_log(location: LogLocation) -> bool:
    """Return whether a format recognises a location, or one of its sub-folders."""
    return any(_format_of(place) is not None for place in (location, *_sub_folders(location)))


def _format_of(location: LogLocation) -> LogFormat | None:
    return next((log_format for log_format in log_formats() if log_format.recognises(location)), None)


def _sub_folders(location: LogLocation) -> list[LogLocation]:
    inner = sorted(location.folder.iterdir()) if location.folder else []
    return [LogLocation.of(path) for path in inner if path.is_dir()]


def _reason_for_no_log(location: LogLocation, logs_inside: list[str]) -> str:
    """Return the reason for which a location is not a log, with the expected formats."""
    if location.folder is None and not location.files:
        return f"log {location.name}: no such file or folder, and no file matches it as a pattern"
    if logs_inside:
        return f"log {location.name}: several logs: name one of {', '.join(logs_inside)}"
    from cdff_dev.logs.content import TEXT, describe

    if (content := describe(location)) not in (None, TEXT):
        return f"log {location.name}: no recording: {content}"
    expected = "; ".join(f"{f.name} ({f.files})" for f in log_formats())
    return f"log {location.name}: none of the known formats: {_content(location)}; expected {expected}"


def _content(location: LogLocation) -> str:
    """Return the content of a location, for an error message."""
    if location.folder is None:
        return f"it begins with {location.head(8)!r}"
    suffixes = Counter(file.suffix or file.name for file in location.folder.rglob("*") if file.is_file())
    counts = [f"{count} {suffix}" for suffix, count in suffixes.most_common(5)]
    return f"the folder holds {', '.join(counts) or 'no'} files"
