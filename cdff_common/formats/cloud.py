# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Content of a point cloud file, independent of the format."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import CodecError, InputError
from cdff_common.geometry.points import checked_points


@dataclass(frozen=True, slots=True, eq=False)
class CloudArrays:
    """Columns of a cloud.

    Attributes
    ----------
    points_m : NDArray[np.float64], shape (n, 3)
        As in the file, including rows that are not finite.
    intensity : NDArray[np.float64], shape (n,), or None
        In the scale of the file.
    colors : NDArray[np.uint8], shape (n, 3), or None
        Red, green, blue.
    normals : NDArray[np.float64], shape (n, 3), or None
    """

    points_m: NDArray[np.float64]
    intensity: NDArray[np.float64] | None = None
    colors: NDArray[np.uint8] | None = None
    normals: NDArray[np.float64] | None = None

    @classmethod
    def of(
        cls,
        points_m: ArrayLike,
        intensity: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        normals: ArrayLike | None = None,
    ) -> CloudArrays:
        """Return the columns after checking their shapes; raises InputError."""
        points = checked_points(points_m, least=0, finite=False)
        n = len(points)
        columns: dict[str, NDArray[np.generic] | None] = {
            "intensity": None if intensity is None else np.asarray(intensity, dtype=np.float64),
            "colors": None if colors is None else np.asarray(colors, dtype=np.uint8),
            "normals": None if normals is None else np.asarray(normals, dtype=np.float64),
        }
        for name, shape in (("intensity", (n,)), ("colors", (n, 3)), ("normals", (n, 3))):
            column = columns[name]
            if column is not None and column.shape != shape:
                raise InputError(f"{name}: shape {column.shape}, expected {shape}")
        return cls(points, **columns)  # type: ignore[arg-type]  # dtypes are set above

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns with the names and types of PLY and PCD files: float32 coordinates."""
        out: dict[str, NDArray[np.generic]] = {}
        for index, name in enumerate("xyz"):
            out[name] = self.points_m[:, index].astype(np.float32)
        if self.normals is not None:
            for index, name in enumerate(("nx", "ny", "nz")):
                out[name] = self.normals[:, index].astype(np.float32)
        if self.intensity is not None:
            out["intensity"] = self.intensity.astype(np.float32)
        if self.colors is not None:
            for index, name in enumerate(("red", "green", "blue")):
                out[name] = np.ascontiguousarray(self.colors[:, index])
        return out

    @classmethod
    def from_columns(cls, columns: Mapping[str, NDArray[np.generic]], subject: str) -> CloudArrays:
        """Return the columns with known names, in any order; raises CodecError if x, y or z is missing.

        Names in capital letters are those in small letters, if both do not exist.
        """
        check_axes(columns, subject)
        columns = {name.lower(): column for name, column in columns.items()} | dict(columns)
        intensity = next((columns[k] for k in _INTENSITY_NAMES if k in columns), None)
        normals = next((n for n in _NORMAL_NAMES if set(n) <= set(columns)), None)
        has_color = {"red", "green", "blue"} <= set(columns)
        return cls(
            points_m=_stack(columns, ("x", "y", "z")),
            intensity=None if intensity is None else np.asarray(intensity, dtype=np.float64),
            colors=_eight_bit(columns) if has_color else None,
            normals=None if normals is None else _stack(columns, normals),
        )


_INTENSITY_NAMES = ("intensity", "scalar_intensity", "i", "reflectance", "remission")
_NORMAL_NAMES = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))


def check_axes(names: Iterable[str], subject: str) -> None:
    """Raise CodecError if x, y or z is not among the names of the columns of a file."""
    known = list(names)
    if not {"x", "y", "z"} <= {name.lower() for name in known}:
        raise CodecError(
            f"{subject}: has {', '.join(known) or 'no columns'}, expected x, y and z among them: rename the "
            "columns of the coordinates"
        )


def _stack(columns: Mapping[str, NDArray[np.generic]], names: tuple[str, ...]) -> NDArray[np.float64]:
    return np.stack([np.asarray(columns[name], dtype=np.float64) for name in names], axis=1)


def _eight_bit(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.uint8]:
    channels = np.stack([columns[name] for name in ("red", "green", "blue")], axis=1)
    if channels.dtype.kind == "f":  # floats are by convention 0 to 1
        channels = np.clip(np.round(channels * 255.0), 0, 255)
    elif channels.dtype.itemsize == 2:
        channels = channels // 257
    return channels.astype(np.uint8)
