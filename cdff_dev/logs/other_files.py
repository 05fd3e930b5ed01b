# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files in the folder of a recording that its reader does not use, with their content."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path

from cdff_dev.logs.content import TEXT, describe
from cdff_dev.logs.formats import LogLocation
from cdff_dev.logs.source import Unconverted

#: More files of one type are listed together.
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
    found: dict[str, Unconverted] = {}
    for suffix, files in sorted(by_suffix.items()):
        if len(files) > _MAX_NAMED:
            found[f"*{suffix}" if suffix else "no suffix"] = Unconverted("file", len(files), reason)
            continue
        for file in files:
            what = _CLOUD if suffix == ".ply" else describe(LogLocation.of(file))
            text = reason if what is None or what == TEXT else what
            found[str(file.relative_to(folder))] = Unconverted("file", 1, text)
    return found
