# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pairs of simulated terrain are reproducible and consistent with their true transform; charts are SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cdff_common.geometry import se3
from evaluation.chart import Panel, chart
from evaluation.scenes.terrain import scan_pair, window_pair


@pytest.mark.parametrize("overlap", [0.3, 0.9])
def test_windows_overlap_by_the_stated_fraction(overlap: float) -> None:
    source, target, T = window_pair(7, overlap)
    repeated, *_ = window_pair(7, overlap)
    np.testing.assert_array_equal(source, repeated)
    distance, _ = cKDTree(target).query(se3.transform_points(T, source))
    near = distance < 0.3
    assert np.mean(near) == pytest.approx(overlap, abs=0.03)
    assert np.median(distance[near]) < 0.1


def test_windows_without_overlap_share_no_terrain() -> None:
    source, target, T = window_pair(7, 0.0)
    distance, _ = cKDTree(target).query(se3.transform_points(T, source))
    assert distance.min() > 3.0


def test_scans_agree_with_their_ground_truth() -> None:
    scene, model, T = scan_pair(7)
    assert 80_000 < len(scene) < 115_200
    distance, _ = cKDTree(scene).query(se3.transform_points(T, model[::50]))
    assert np.median(distance) < 0.1


def test_a_chart_is_well_formed_and_omits_missing_values() -> None:
    panel = Panel(
        "recall, %", ["a", "b"], {"ours": [(50.0, 40.0, 60.0), None], "peer": [None, None]}, 100.0, (5.0, 7.0)
    )
    root = ElementTree.fromstring(chart([panel, panel]).decode())
    texts = [text.text for text in root.iter("{http://www.w3.org/2000/svg}text")]
    assert texts.count("ours") == texts.count("peer") == 2
