# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate the inflation factors of icp_localisation's covariances from simulated lidar scans.

The sandwich estimate of CrossInformation models the noise of residuals, not the bias of correspondences and
normals. Each implementation therefore has two factors, one for the translation of the centre of the overlap,
one for the rotation about it. They maximise the likelihood of the errors of the training seeds, and are
``covariance_inflation`` and ``rotation_inflation`` of the slot ``assess`` in ``dfpc.yaml``.
``docs/evaluation/icp_localisation.json`` contains the check on other seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from evaluation.runs.icp import IMPLEMENTATIONS, localise, make_dfpc
from evaluation.scenes.terrain import scan_pair

TRAINING_SEEDS = range(1000, 1171)
#: Parameters that leave the covariance unscaled.
_UNSCALED = {"covariance_inflation": 1.0, "rotation_inflation": 1.0, "floor_spacings": 0.0}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the factors fitted to the training seeds, and the shipped factors."""
    dfpcs = {name: make_dfpc(name, assess=_UNSCALED) for name in IMPLEMENTATIONS}
    results: dict[str, list[tuple[FloatArray, FloatArray]]] = {name: [] for name in IMPLEMENTATIONS}
    for seed in TRAINING_SEEDS:
        progress(f"icp_calibration: seed {seed}")
        scene, model, T_true = scan_pair(seed)
        for name, dfpc in dfpcs.items():
            output, _ = localise(dfpc, scene, model)
            if output.value is not None:
                results[name].append(_about_centre(output.value.transform, T_true, output.quality.metrics))
    return {
        name: {"seeds": [TRAINING_SEEDS[0], TRAINING_SEEDS[-1]], "answered": len(entries)}
        | dict(zip(("translation", "rotation"), inflations(entries), strict=True))
        | {"shipped": _shipped(dfpcs[name])}
        for name, entries in results.items()
    }


def inflations(entries: list[tuple[FloatArray, FloatArray]]) -> tuple[float, float]:
    """Return the factors on the variances of translation and rotation that maximise the likelihood of errors.

    Parameters
    ----------
    entries : list of (ndarray, ndarray)
        Error (6,) and stated covariance (6, 6).
    """
    from scipy.optimize import minimize

    errors = np.stack([error for error, _ in entries])
    information = np.linalg.inv(np.stack([covariance for _, covariance in entries]))

    def negative_log_likelihood(log_sigmas: FloatArray) -> float:
        scaled = errors / np.exp(np.repeat(log_sigmas, 3))
        squared = np.einsum("ni,nij,nj->n", scaled, information, scaled)
        return float(0.5 * squared.mean() + 3.0 * log_sigmas.sum())

    translation, rotation = np.exp(2.0 * minimize(negative_log_likelihood, np.zeros(2)).x)
    return round(float(translation), 2), round(float(rotation), 2)


def _about_centre(T: Any, T_true: FloatArray, metrics: Any) -> tuple[FloatArray, FloatArray]:
    """Return error and covariance as translation of the overlap's centre and rotation about it.

    Rotations are multiplied by the radius of the overlap.
    """
    centre, radius_m = np.array([metrics[f"overlap_{axis}_m"] for axis in "xyz"]), metrics["overlap_radius_m"]
    A = np.eye(6)
    A[:3, 3:] = -se3.skew(T.matrix[:3, 3] - centre)
    M = np.linalg.inv(A @ np.diag([1.0] * 3 + [1.0 / radius_m] * 3))
    return M @ pose_error(T_true, T.matrix), M @ T.covariance @ M.T


def _shipped(dfpc: Any) -> list[float]:
    variant = next(i for i in dfpc.description.implementations if i.name == dfpc.implementation)
    parameters = next(slot for slot in variant.dfns if slot.dfn_id == "assess").parameters
    return [float(parameters[key]) for key in ("covariance_inflation", "rotation_inflation")]
