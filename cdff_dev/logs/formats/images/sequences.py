# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sequences of images in a folder: files whose names differ only in numbers."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cdff_dev.logs.file_stamps import natural_order
from cdff_dev.logs.image_streams import IMAGE_SUFFIXES

_NUMBER = re.compile(r"-?\d+")
_DEPTH = "depth"
_OTHER_THAN_WORDS = re.compile(r"[^a-z0-9]+")


@dataclass(frozen=True, slots=True)
class ImageSequence:
    """Images of one camera.

    Attributes
    ----------
    sensor : str
        Name of the camera: that of the sub-folder, or the common part of the names of the files.
    pattern : str
        Names of the files, with ``#`` for each number.
    files : tuple of Path
        In the order of the numbers in their names.
    """

    sensor: str
    pattern: str
    files: tuple[Path, ...]

    @property
    def folder(self) -> Path:
        """Folder of the images."""
        return self.files[0].parent

    @property
    def is_depth(self) -> bool:
        """True if the name of the sequence contains "depth"."""
        return _DEPTH in self.sensor


def image_sequences(folder: Path) -> list[ImageSequence]:
    """Return the sequences of a folder and of its sub-folders, one level deep, with different names."""
    places = (folder, *sorted(path for path in folder.iterdir() if path.is_dir()))
    files = (file for place in places for file in place.iterdir())
    return sequences_of([f for f in files if f.suffix.lower() in IMAGE_SUFFIXES and f.is_file()])


def sequences_of(files: Sequence[Path]) -> list[ImageSequence]:
    """Return the sequences of images, with different names."""
    files_by_pattern: dict[tuple[Path, str], list[Path]] = defaultdict(list)
    for file in files:
        files_by_pattern[file.parent, _NUMBER.sub("#", file.name)].append(file)
    sequences: list[ImageSequence] = []
    for (place, pattern), files in files_by_pattern.items():
        alone = sum(other == place for other, _ in files_by_pattern) == 1
        name = _sensor(place.name if alone and _DEPTH not in pattern else pattern.rpartition(".")[0])
        if len(files_by_pattern) == 1 and _DEPTH not in name:
            name = "camera"
        elif any(other.sensor == name for other in sequences):
            name = f"{_sensor(place.name)}_{name}"
        sequences.append(ImageSequence(name, pattern, tuple(sorted(files, key=natural_order))))
    return sequences


def last_number(file: Path) -> int | None:
    """Return the last number in the name of a file."""
    numbers = _NUMBER.findall(file.stem)
    return abs(int(numbers[-1])) if numbers else None


def _sensor(text: str) -> str:
    """Return a name in lower-case words; ``camera`` if nothing is left without numbers."""
    return _OTHER_THAN_WORDS.sub("_", text.lower().replace("#", "")).strip("_") or "camera"
