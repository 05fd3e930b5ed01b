# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Field conditions change images as stated, and cells count confident wrong poses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output
from cdff_common.interfaces.product import CovarianceKind, Quality
from evaluation.data_sets.image_conditions import View, conditions, stereo_conditions
from evaluation.runs.visual_conditions import ImageSet
from evaluation.visual_field_conditions import score, table

K = np.array([[60.0, 0.0, 39.5], [0.0, 60.0, 29.5], [0.0, 0.0, 1.0]])
COUNT = 6


def views(channels: int = 0) -> list[View]:
    """Return stereo views of noise, all different."""
    shape = (60, 80, channels) if channels else (60, 80)
    rng = np.random.default_rng(0)
    return [
        View(tuple(rng.integers(40, 160, shape).astype(np.uint8) for _ in range(2)), K, (i + 1) * 10**8, i)
        for i in range(COUNT)
    ]


ALL = conditions() | stereo_conditions()


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("channels", [0, 3])
def test_a_condition_keeps_types_and_order_and_changes_the_views(name: str, channels: int) -> None:
    before = views(channels)
    after = ALL[name](before)
    assert [v.index for v in after] == sorted(v.index for v in after)
    for view in after:
        assert view.stamp_ns == before[view.index].stamp_ns
        assert all(image.dtype == np.uint8 for image in view.images)
        assert [image.shape for image in view.images] == [image.shape for image in before[0].images]
    unchanged = len(after) == len(before) and all(
        np.array_equal(a, b)
        for v, w in zip(after, before, strict=True)
        for a, b in zip(v.images, w.images, strict=True)
    )
    assert unchanged == (name in ("none", "focal length 3 % too long"))


def test_faults_of_a_camera_are_those_of_their_names() -> None:
    before = views()
    lost = ALL["right camera lost"](before)
    assert [int(v.images[1].max()) > 0 for v in lost] == [True] * 3 + [False] * 3
    assert all(v.images[0].max() > 0 for v in lost)
    swapped = ALL["cameras swapped"](before)
    np.testing.assert_array_equal(swapped[2].images[0], before[2].images[1])
    late = ALL["right image one frame late"](before)
    np.testing.assert_array_equal(late[0].images[1], before[0].images[1])
    assert [v.index for v in late] == [1, 2, 3, 4, 5]
    assert [v.index for v in ALL["two frames missing"](before)] == [0, 1, 2, 5]
    lower = ALL["right image two rows lower"](before)[0].images[1]
    np.testing.assert_array_equal(lower[2:], before[0].images[1][:-2])
    assert ALL["focal length 3 % too long"](before)[0].camera_matrix[0, 0] == pytest.approx(61.8)


def answers(errors_m: list[float], reasons: list[str], sigma_m: float) -> list[tuple[View, Output]]:
    """Return one view per error, 1 m apart along x, each with an output whose pose has this error."""
    results = []
    for view, error_m, reason in zip(views(), errors_m, reasons, strict=True):
        T = se3.transform(np.eye(3), [view.index + error_m, 0.0, 0.0])
        quality = Quality.from_reasons([reason] if reason else [], CovarianceKind.FORMAL, {})
        pose = UncertainTransform(T, np.diag([sigma_m**2] * 3 + [1e-4] * 3))
        output = Output.of_pose(
            "pose",
            pose,
            stamp_ns=view.stamp_ns,
            frame="map",
            child="camera",
            quality=quality,
            inputs=(),
            producer="test",
        )
        results.append((view, output))
    return results


def image_set() -> ImageSet:
    truth = np.array([se3.transform(np.eye(3), [float(i), 0.0, 0.0]) for i in range(COUNT)])
    return ImageSet(views(), truth, 0.001, 0.01, baseline_m=0.1)


def test_only_ok_poses_beyond_three_sigmas_are_counted() -> None:
    errors_m = [0.0, 0.01, 0.5, 0.5, 0.0, 0.02]
    cell = score(answers(errors_m, ["", "", "", "blurred", "", ""], 0.01), image_set())
    assert cell["status"] == [5, 1, 0]
    assert cell["ok_beyond_3_sigma"] == 1
    assert (cell["median_m"], cell["largest_m"]) == (0.015, 0.5)
    assert cell["reasons"] == {"blurred": 1}
    wide = score(answers(errors_m, [""] * COUNT, 0.3), image_set())
    assert wide["ok_beyond_3_sigma"] == 0


def test_relative_poses_are_compared_from_the_first_located_view() -> None:
    shifted = score(answers([0.2] * COUNT, [""] * COUNT, 0.01), image_set(), is_relative=True)
    assert (shifted["largest_m"], shifted["ok_beyond_3_sigma"]) == (0.0, 0)


def test_the_table_states_confident_errors_and_cells_without_a_pose() -> None:
    cells: dict[str, Any] = {
        "visual_slam": {
            "status": [9, 0, 0],
            "reasons": {},
            "median_m": 0.01,
            "largest_m": 0.3,
            "ok_beyond_3_sigma": 2,
        },
        "visual_localisation": {"status": [0, 0, 8], "reasons": {"not_on_the_map": 8}},
    }
    text = table({"euroc": {"noise": cells}})
    assert "| noise | 0.010 m, 9/0/0 **2 OK beyond 3 σ** | no pose, 0/0/8 `not_on_the_map` |" in text
    assert text.endswith("1 of 2 cells contain a pose with status OK and an error above 3 σ.")
