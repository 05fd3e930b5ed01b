# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ScanDetector: which poses are alternatives to the best one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.object_models.scan_detection import DetectionLimits, ScanDetector

HALF_TURN = se3.transform(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))


@pytest.mark.parametrize(
    ("costs", "rows"),
    [
        ([100.0, 108.0], [0, 1]),
        ([100.0, 110.0], [0]),
        # Of a cost of 1000 a search can leave 2 %.
        ([1000.0, 1019.0], [0, 1]),
        ([1000.0, 1021.0], [0]),
    ],
)
def test_alternatives_have_nearly_the_cost_of_the_best_pose(costs: list[float], rows: list[int]) -> None:
    limits = DetectionLimits(sigma_m=0.01, min_points=10, min_score=0.8, ambiguity=9.0)
    detector: Any = ScanDetector(SimpleNamespace(), SimpleNamespace(), limits)  # type: ignore[arg-type]
    model = SimpleNamespace(symmetries=np.eye(4)[None], centre_m=np.zeros(3), diameter_m=1.0)
    refined = SimpleNamespace(poses=np.stack([np.eye(4), HALF_TURN]), costs=np.array(costs))
    assert detector._alternatives(model, refined) == rows
    symmetric = SimpleNamespace(**vars(model) | {"symmetries": np.stack([np.eye(4), HALF_TURN])})
    assert detector._alternatives(symmetric, refined) == [0]
