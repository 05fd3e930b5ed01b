# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What icp_localisation's covariances must be multiplied with: learnt from simulated lidar scans of training seeds.

The sandwich of CrossInformation knows the noise of residuals, not the bias of correspondences and normals. One factor
for each implementation makes the mean squared normalised error 6; ``covariance_inflation`` of the slot ``assess`` in
``dfpc.yaml`` carries it. ``docs/evaluation/icp_localisation.json`` holds the check on other seeds.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry.covariance import pose_error
from cdff_dev.evaluate._icp import IMPLEMENTATIONS, localised, made
from cdff_dev.evaluate._terrain import scan_pair

TRAINING_SEEDS = range(1000, 1171)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Inflation that the training seeds ask for, and the one that is shipped."""
    dfpcs = {name: made(name, assess={"covariance_inflation": 1.0, "floor_spacings": 0.0}) for name in IMPLEMENTATIONS}
    nees: dict[str, list[float]] = {name: [] for name in IMPLEMENTATIONS}
    for seed in TRAINING_SEEDS:
        progress(f"icp_calibration: seed {seed}")
        scene, model, T_true = scan_pair(seed)
        for name, dfpc in dfpcs.items():
            output, _ = localised(dfpc, scene, model)
            if output.value is not None:
                T = output.value.transform
                e = pose_error(T_true, T.matrix)
                nees[name].append(float(e @ np.linalg.solve(T.covariance, e)))
    return {
        name: {
            "seeds": [TRAINING_SEEDS[0], TRAINING_SEEDS[-1]], "answered": len(values),
            "inflation": round(float(np.mean(values)) / 6.0, 2), "shipped": _shipped(dfpcs[name]),
        }
        for name, values in nees.items()
    }  # fmt: skip


def _shipped(dfpc: Any) -> float:
    variant = next(i for i in dfpc.description.implementations if i.name == dfpc.implementation)
    return float(next(slot for slot in variant.dfns if slot.dfn_id == "assess").parameters["covariance_inflation"])
