# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from tests.support import textured_walls as walls

STEP_NS = 100_000_000


def shifted(T: np.ndarray, offset_px: float) -> FramePair:
    """Return a pair whose right image is shifted to the right, as by a wrong rectification."""
    T_right = T @ se3.transform(np.eye(3), [walls.BASELINE_M, 0.0, 0.0])
    right = cv2.warpAffine(
        walls.view(T_right),
        np.array([[1.0, 0.0, offset_px], [0.0, 1.0, 0.0]]),
        walls.SIZE,
        flags=cv2.INTER_CUBIC,
    )
    return FramePair.from_images(
        walls.view(T), right, baseline_m=walls.BASELINE_M, camera_matrix=walls.K, stamp_ns=0
    )


def driven(offset_px: float) -> tuple[float, float]:
    """Return the estimated offset after an approach to the walls, and the error of the distance, metres."""
    dfpc = Registry.default().make_dfpc("visual_slam")
    dfpc.configure({"keyframes": {"translation_ratio": 0.03}})
    distance_m = 0.0
    for i in range(10):
        T = se3.transform(np.eye(3), [0.01 * i, 0.0, 0.15 * i])
        for output in dfpc.step(Sample("pair", (i + 1) * STEP_NS, i, shifted(T, offset_px))):
            if output.port == "pose":
                distance_m = float(np.linalg.norm(output.value.transform.matrix[:3, 3]))
    metrics = next(iter(dfpc.finish())).quality.metrics
    return metrics["disparity_offset_px"], abs(distance_m - float(np.linalg.norm([0.09, 1.35])))


def test_an_offset_of_the_disparities_is_estimated_and_corrected() -> None:
    offset_px, error_m = driven(0.8)
    assert offset_px == pytest.approx(0.8, abs=0.15)
    assert error_m < 0.02


def test_a_right_rectification_is_left_as_it_is() -> None:
    offset_px, error_m = driven(0.0)
    assert abs(offset_px) < 0.1
    assert error_m < 0.01
