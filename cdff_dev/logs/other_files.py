# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files in the folder of a recording that its reader does not use, with their content."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path

from cdff_dev.logs.content import TEXT, describe
from cdff_dev.logs.formats import LogLocation, log_formats
from cdff_dev.logs.source import Unconverted

#: Largest number of files of one type that are listed by name; more are listed together.
_MAX_NAMED = 3
#: Files that describe a data set and are not part of the recording.
_DESCRIPTIONS = ("readme", "license")
_CLOUD = "a model or point cloud: open it alone"


def other_files(
    folder: Path, is_read: Callable[[Path], bool], reason: str, patterns: Iterable[str] = ("*", "*/*")
) -> dict[str, Unconverted]:
    """Return the files of a folder that are neither read nor descriptions: a few by name, many by type.

    Parameters
    ----------
    folder : Path
    is_read : callable
        Whether the reader uses a file.
    reason : str
        Reason for a file whose content has no description.
    patterns : iterable of str
        Patterns of the files in the folder.
    """
    by_suffix: dict[str, list[Path]] = defaultdict(list)
    for pattern in patterns:
        for file in sorted(folder.glob(pattern)):
            if file.is_file() and not file.name.lower().startswith(_DESCRIPTIONS) and not is_read(file):
                by_suffix[file.suffix.lower()].append(file)
    contents: dict[str, Unconverted] = {}
    for suffix, files in sorted(by_suffix.items()):
        if len(files) > _MAX_NAMED:
            counts = Counter(_content_of(file) or reason for file in files)
            reasons = [f"{n} x {text}" for text, n in counts.most_common()] if len(counts) > 1 else counts
            contents[f"*{suffix}" if suffix else "no suffix"] = Unconverted(
                "file", len(files), "; ".join(reasons)
            )
            continue
        for file in files:
            text = _content_of(file) or reason
            contents[str(file.relative_to(folder))] = Unconverted("file", 1, text)
    return contents


def _content_of(file: Path) -> str:
    """Return the content of a file in a few words; empty if it is unknown, or a text without a structure."""
    if file.suffix.lower() in (".ply", ".pcd"):
        return _CLOUD
    location = LogLocation.of(file)
    if log_format := next((f for f in log_formats() if not f.is_generic and f.recognises(location)), None):
        return f"{log_format.name}: open it alone"
    description = describe(location)
    return "" if description is None or description == TEXT else description
