# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What icp_localisation's covariances must be multiplied with: learnt from simulated lidar scans of training seeds.

The sandwich of CrossInformation knows the noise of residuals, not the bias of correspondences and normals. Two factors
for each implementation, on translations of the overlap's centre and on turns about it, make the errors of the training
seeds most likely; ``covariance_inflation`` and ``rotation_inflation`` of the slot ``assess`` in ``dfpc.yaml`` carry
them. ``docs/evaluation/icp_localisation.json`` holds the check on other seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.evaluate._icp import IMPLEMENTATIONS, localised, made
from cdff_dev.evaluate._terrain import scan_pair

TRAINING_SEEDS = range(1000, 1171)
_RAW = {"covariance_inflation": 1.0, "rotation_inflation": 1.0, "floor_spacings": 0.0}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Inflations that the training seeds ask for, and those that are shipped."""
    dfpcs = {name: made(name, assess=_RAW) for name in IMPLEMENTATIONS}
    found: dict[str, list[tuple[FloatArray, FloatArray]]] = {name: [] for name in IMPLEMENTATIONS}
    for seed in TRAINING_SEEDS:
        progress(f"icp_calibration: seed {seed}")
        scene, model, T_true = scan_pair(seed)
        for name, dfpc in dfpcs.items():
            output, _ = localised(dfpc, scene, model)
            if output.value is not None:
                found[name].append(_about_centre(output.value.transform, T_true, output.quality.metrics))
    return {
        name: {"seeds": [TRAINING_SEEDS[0], TRAINING_SEEDS[-1]], "answered": len(entries)}
        | dict(zip(("translation", "rotation"), inflations(entries), strict=True))
        | {"shipped": _shipped(dfpcs[name])}
        for name, entries in found.items()
    }


def inflations(entries: list[tuple[FloatArray, FloatArray]]) -> tuple[float, float]:
    """Factors on the variances of translation and rotation that maximise the likelihood of errors ``(6,)``.

    Parameters
    ----------
    entries : list of (ndarray, ndarray)
        Error (6,) and stated covariance (6, 6).
    """
    from scipy.optimize import minimize

    errors = np.stack([error for error, _ in entries])
    information = np.linalg.inv(np.stack([covariance for _, covariance in entries]))

    def unlikelihood(log: FloatArray) -> float:
        scaled = errors / np.exp(np.repeat(log, 3))
        return float(0.5 * np.einsum("ni,nij,nj->n", scaled, information, scaled).mean() + 3.0 * log.sum())

    translation, rotation = np.exp(2.0 * minimize(unlikelihood, np.zeros(2)).x)
    return round(float(translation), 2), round(float(rotation), 2)


def _about_centre(T: Any, T_true: FloatArray, metrics: Any) -> tuple[FloatArray, FloatArray]:
    """Error and covariance of a shift of the overlap's centre and a turn about it, rotations times its radius."""
    centre, radius_m = np.array([metrics[f"overlap_{axis}_m"] for axis in "xyz"]), metrics["overlap_radius_m"]
    A = np.eye(6)
    A[:3, 3:] = -se3.skew(T.matrix[:3, 3] - centre)
    M = np.linalg.inv(A @ np.diag([1.0] * 3 + [1.0 / radius_m] * 3))
    return M @ pose_error(T_true, T.matrix), M @ T.covariance @ M.T


def _shipped(dfpc: Any) -> list[float]:
    variant = next(i for i in dfpc.description.implementations if i.name == dfpc.implementation)
    parameters = next(slot for slot in variant.dfns if slot.dfn_id == "assess").parameters
    return [float(parameters[key]) for key in ("covariance_inflation", "rotation_inflation")]
