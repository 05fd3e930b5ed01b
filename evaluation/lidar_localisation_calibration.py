# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate the parameters ``map_sigma_*`` of lidar localisation: the pose errors caused by the map.

One sweep is localised on each of many maps with different errors. The parameters are the root mean square
errors. For the check, they are computed from one half of the maps; the NEES is then computed on the other
half, with the sum of both covariances. ``lidar_localisation`` uses other maps and poses.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.product import Status
from cdff_core.dfpcs.lidar_localisation.configuration import LidarLocalisationConfig
from cdff_dev.compare.registration.rates import nees_band
from evaluation.lidar_localisation import localise, make_localiser, simulated_ground, trial

TRAINING_SEEDS = range(200, 280)
_NAMES = ("map_sigma_xy_m", "map_sigma_z_m", "map_sigma_tilt_deg", "map_sigma_yaw_deg")
_WITHOUT_MAP_ERRORS: dict[str, Any] = dict.fromkeys(_NAMES, 0.0)


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the root mean square errors, the shipped parameters, and the NEES of each half of the maps."""
    ground = simulated_ground()
    errors, stated_covariances = [], []
    for seed in TRAINING_SEEDS:
        progress(f"lidar localisation: calibration, seed {seed}")
        T, points, _ = trial(ground, 200_000 + seed)
        output = localise(
            make_localiser(ground.map(seed), **_WITHOUT_MAP_ERRORS), points, UncertainTransform(T)
        )
        if output.quality.status is not Status.FAILED:
            errors.append(pose_error(T, output.value.transform.matrix))
            stated_covariances.append(output.value.transform.covariance)
    error_array, C = np.stack(errors), np.stack(stated_covariances)
    halves = (slice(0, None, 2), slice(1, None, 2))
    nees_of_halves = [
        _mean_nees(error_array[b], C[b], sigmas(error_array[a])) for a, b in (halves, halves[::-1])
    ]
    shipped = LidarLocalisationConfig()
    return {
        "seeds": [TRAINING_SEEDS[0], TRAINING_SEEDS[-1]],
        "answered": len(error_array),
        "rms": dict(zip(_NAMES, np.round(sigmas(error_array), 5).tolist(), strict=True)),
        "shipped": {name: getattr(shipped, name) for name in _NAMES},
        "mean_nees_of_one_half_by_the_other": [round(v, 2) for v in nees_of_halves],
        "band_95": [round(v, 2) for v in nees_band(len(error_array) // 2)],
    }


def sigmas(errors: FloatArray) -> FloatArray:
    """Return the root mean squares (4,) of errors ``(n, 6)``: x and y, z (metres), tilt, yaw (degrees)."""
    square = np.mean(errors**2, axis=0)
    return np.sqrt([square[:2].mean(), square[2], square[3:5].mean(), square[5]]) * np.array(
        [1, 1, *np.degrees([1, 1])]
    )


def _mean_nees(errors: FloatArray, covariances: FloatArray, sigma: FloatArray) -> float:
    xy, z, tilt, yaw = sigma[0], sigma[1], *np.radians(sigma[2:])
    C = covariances + np.diag(np.square([xy, xy, z, tilt, tilt, yaw]))
    return float(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(C), errors).mean())
