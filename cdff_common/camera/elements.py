# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Numbers and matrices of calibration files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError

#: Largest number of elements of one matrix or vector: a calibration has a few dozen.
_MAX_ELEMENTS = 10_000
Cameras = dict[str, CameraModel]
#: ``T_camera_body`` of each camera. The body frame is that of the IMU, if the file has its pose.
Poses = dict[str, NDArray[np.float64]]


def square(value: Any, n: int = 3) -> NDArray[np.float64]:
    """Return a matrix ``(n, n)``; raises ValueError if there are not ``n * n`` numbers."""
    return np.asarray(_data(value), dtype=np.float64).reshape(n, n)


def _data(value: Any) -> Any:
    """Return the elements of a matrix of ROS (``rows``, ``cols``, ``data``), or the value itself."""
    return value["data"] if isinstance(value, Mapping) else value


def numbers(value: Any) -> Sequence[float]:
    """Return all elements in order; raises InputError if they are too many or not finite."""
    value = _data(value)
    flat = np.asarray(value, dtype=np.float64).reshape(-1)
    if len(flat) > _MAX_ELEMENTS or not np.isfinite(flat).all():
        raise InputError(f"{len(flat)} numbers, expected finite ones and at most {_MAX_ELEMENTS}")
    return [float(v) for v in flat]
