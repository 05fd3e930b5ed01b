# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""TUM trajectories: lines ``stamp_s x y z qx qy qz qw``.

Sturm et al. (2012), doi:10.1109/IROS.2012.6385773. Stamps are rounded to microseconds, as in messages.
"""

from __future__ import annotations

from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.formats.file_source import Readable, load
from cdff_common.geometry import se3


def read_tum(source: Readable) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read stamps ``(n,)`` in nanoseconds, rounded to microseconds, and matrices ``(n, 4, 4)``.

    Raises
    ------
    CodecError
        With file name and line, if a line does not have 8 numbers with a unit quaternion.
    """
    s = load(source)
    stamps, rows = [], []
    for number, line in enumerate(s.data.decode("utf-8", "replace").splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            if len(words) != 8:
                raise ValueError(f"{len(words)} numbers")
            stamps.append(int((Decimal(words[0]) * 1_000_000).to_integral_value()) * 1000)
            rows.append([float(w) for w in words[1:]])
        except (ValueError, InvalidOperation, OverflowError) as error:
            raise s.error(f"line {number}: {error}; expected stamp_s x y z qx qy qz qw") from error
    table = np.array(rows, dtype=np.float64).reshape(-1, 7)
    norm = np.linalg.norm(table[:, 3:], axis=1)
    if not (np.all(np.isfinite(table)) and np.all(np.abs(norm - 1.0) < 0.01)):
        raise s.error("a pose is not finite or its quaternion is not of unit length")
    T = np.zeros((0, 4, 4))
    if len(table):
        T = se3.transform_from_quaternion_xyzw(table[:, :3], table[:, 3:])
    try:
        return np.array(stamps, dtype=np.int64), T
    except OverflowError as error:
        raise s.error("a stamp does not fit 64 bits of nanoseconds") from error


def write_tum(stamps_ns: ArrayLike, matrices: ArrayLike) -> bytes:
    """Return a trajectory as TUM text: stamps ``(n,)`` in nanoseconds, rigid matrices ``(n, 4, 4)``."""
    stamps = np.asarray(stamps_ns, dtype=np.int64).reshape(-1)
    T = np.asarray(matrices, dtype=np.float64).reshape(-1, 4, 4)
    if len(stamps) != len(T):
        raise InputError(f"{len(stamps)} stamps for {len(T)} poses, expected equal numbers")
    q_xyzw = se3.quaternion_xyzw_from_matrix(T[:, :3, :3]) if len(T) else np.zeros((0, 4))
    lines = [
        " ".join([_seconds(int(stamp)), *(f"{v:.9f}" for v in (*pose[:3, 3], *q))])
        for stamp, pose, q in zip(stamps, T, q_xyzw, strict=True)
    ]
    return "".join(f"{line}\n" for line in lines).encode()


def _seconds(stamp_ns: int) -> str:
    """Return exact decimal seconds; a float cannot represent microseconds since 1970."""
    sign, us = ("-", -stamp_ns // 1000) if stamp_ns < 0 else ("", stamp_ns // 1000)
    return f"{sign}{us // 1_000_000}.{us % 1_000_000:06d}"
