# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Validation of point arrays and transforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray


def checked_points(
    points: ArrayLike, name: str = "points", least: int = 1, *, finite: bool = True
) -> FloatArray:
    """Return ``points`` as a C-contiguous float64 array of shape (n, 3).

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Metres.
    name : str
        Name in error messages.
    least : int
        Smallest accepted number of rows.
    finite : bool
        Refuse values that are not finite.

    Raises
    ------
    InputError
        If the shape is wrong, rows are missing, or values are invalid.
    """
    try:
        p = np.ascontiguousarray(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected an array of numbers of shape (n, 3): {error}") from error
    if p.ndim != 2 or p.shape[1] != 3:
        raise InputError(f"{name}: shape {p.shape}, expected (n, 3)")
    if finite and not np.all(np.isfinite(p)):
        invalid_count = int(np.count_nonzero(~np.all(np.isfinite(p), axis=1)))
        raise InputError(f"{name}: {invalid_count} of {len(p)} rows are not finite; filter the cloud first")
    if len(p) < least:
        raise InputError(f"{name}: {len(p)} points, expected at least {least}")
    return p


def checked_transform(T: ArrayLike, name: str = "transform") -> FloatArray:
    """Return a copy of a rigid ``(4, 4)`` transform; raises InputError if it is not rigid."""
    try:
        m = np.array(T, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected a 4x4 array of numbers: {error}") from error
    if not se3.is_transform(m, tolerance=1e-5):
        raise InputError(f"{name} {m.tolist()}: expected a finite rigid 4x4 transform")
    return m
