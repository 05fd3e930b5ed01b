# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pairs of simulated terrain are made from their seed alone and fit their truth; charts are well-formed SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cdff_common.geometry import se3
from cdff_dev.evaluate._chart import Panel, chart
from cdff_dev.evaluate._terrain import scan_pair, window_pair


@pytest.mark.parametrize("overlap", [0.3, 0.9])
def test_windows_overlap_as_much_as_they_say_under_their_truth(overlap: float) -> None:
    source, target, T = window_pair(7, overlap)
    again, *_ = window_pair(7, overlap)
    np.testing.assert_array_equal(source, again)
    distance, _ = cKDTree(target).query(se3.transform_points(T, source))
    near = distance < 0.3
    assert np.mean(near) == pytest.approx(overlap, abs=0.03)
    assert np.median(distance[near]) < 0.1


def test_without_overlap_the_windows_share_no_ground() -> None:
    source, target, T = window_pair(7, 0.0)
    distance, _ = cKDTree(target).query(se3.transform_points(T, source))
    assert distance.min() > 3.0


def test_scans_fit_their_truth() -> None:
    scene, model, T = scan_pair(7)
    assert 80_000 < len(scene) < 115_200
    distance, _ = cKDTree(scene).query(se3.transform_points(T, model[::50]))
    assert np.median(distance) < 0.1


def test_a_chart_is_well_formed_and_leaves_out_what_is_missing() -> None:
    panel = Panel(
        "recall, %", ["a", "b"], {"ours": [(50.0, 40.0, 60.0), None], "peer": [None, None]}, 100.0, (5.0, 7.0)
    )
    root = ElementTree.fromstring(chart([panel, panel]).decode())
    assert len(root.findall("{http://www.w3.org/2000/svg}circle")) == 2
    assert "ours" in [text.text for text in root.iter("{http://www.w3.org/2000/svg}text")]
