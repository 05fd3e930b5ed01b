# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What errors of the map leave in a pose of lidar localisation: its parameters ``map_sigma_*``, and a check of them.

A sweep on each of many maps, every map put down with errors of its own. The root mean square errors are the
parameters. The check takes those of one half of the maps, and the squared normalised errors of the other half by them
and by what the assessment knows. ``lidar_localisation`` has other maps and places.
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
from cdff_core.dfpcs.lidar_localisation._configuration import LidarLocalisationConfig
from cdff_dev.evaluate.lidar_localisation import localised, localiser, place, trial
from cdff_dev.registration.rates import nees_band

TRAINING_SEEDS = range(200, 280)
_NAMES = ("map_sigma_xy_m", "map_sigma_z_m", "map_sigma_tilt_deg", "map_sigma_yaw_deg")
_WITHOUT: dict[str, Any] = dict.fromkeys(_NAMES, 0.0)


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Root mean square errors, those shipped, and the check of each half by the other."""
    ground = place()
    errors, stated = [], []
    for seed in TRAINING_SEEDS:
        progress(f"lidar localisation: calibration, seed {seed}")
        T, points, _ = trial(ground, 200_000 + seed)
        output = localised(localiser(ground.map(seed), **_WITHOUT), points, UncertainTransform(T))
        if output.quality.status is not Status.FAILED:
            errors.append(pose_error(T, output.value.transform.matrix))
            stated.append(output.value.transform.covariance)
    e, C = np.stack(errors), np.stack(stated)
    halves = (slice(0, None, 2), slice(1, None, 2))
    checked = [_mean_nees(e[b], C[b], sigmas(e[a])) for a, b in (halves, halves[::-1])]
    shipped = LidarLocalisationConfig()
    return {
        "seeds": [TRAINING_SEEDS[0], TRAINING_SEEDS[-1]], "answered": len(e),
        "rms": dict(zip(_NAMES, np.round(sigmas(e), 5).tolist(), strict=True)),
        "shipped": {name: getattr(shipped, name) for name in _NAMES},
        "mean_nees_of_one_half_by_the_other": [round(v, 2) for v in checked],
        "band_95": [round(v, 2) for v in nees_band(len(e) // 2)],
    }  # fmt: skip


def sigmas(errors: FloatArray) -> FloatArray:
    """Root mean squares (4,) of errors ``(n, 6)``: along x and y, along z, about x and y, about z; metres, degrees."""
    square = np.mean(errors**2, axis=0)
    return np.sqrt([square[:2].mean(), square[2], square[3:5].mean(), square[5]]) * np.array(
        [1, 1, *np.degrees([1, 1])]
    )


def _mean_nees(errors: FloatArray, covariances: FloatArray, sigma: FloatArray) -> float:
    xy, z, tilt, yaw = sigma[0], sigma[1], *np.radians(sigma[2:])
    C = covariances + np.diag(np.square([xy, xy, z, tilt, tilt, yaw]))
    return float(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(C), errors).mean())
