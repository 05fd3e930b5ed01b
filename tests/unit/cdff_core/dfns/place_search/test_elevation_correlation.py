# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Place search by elevation correlation: accuracy and separation of the candidates, refused scans."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.place_search.interface import PlaceSearchInputs
from tests.support.mapped_hills import Hills


def search(map_points: np.ndarray, scan: np.ndarray, **config: object) -> Any:
    node = Registry.default().make_dfn("place_search")
    node.configure(config)
    return node.process(PlaceSearchInputs(map=map_points, scan=scan))


@pytest.mark.parametrize("seed", range(5))
def test_the_first_candidate_is_within_the_convergence_range_of_registration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hills = Hills(seed)
    T = hills.pose(*rng.uniform(-20, 20, 2), rng.uniform(-np.pi, np.pi))
    outputs = search(hills.map(rng, 0.4), hills.scan(rng, T))
    E = se3.inverse(T) @ outputs.transforms[0]
    assert np.linalg.norm(E[:3, 3]) < 2.0
    assert np.degrees(se3.rotation_angle(E[:3, :3])) < 15.0
    assert np.all(np.diff(outputs.residuals_m) >= 0.0)
    assert outputs.searched > 10_000


def test_candidates_differ_in_position_or_heading(rng: np.random.Generator) -> None:
    hills = Hills()
    outputs = search(hills.map(rng, 0.4), hills.scan(rng, hills.pose(0, 0, 0)), candidates=10)
    for i, A in enumerate(outputs.transforms):
        for B in outputs.transforms[:i]:
            distance_m = np.linalg.norm(A[:3, 3] - B[:3, 3])
            rotation_deg = np.degrees(se3.rotation_angle(A[:3, :3].T @ B[:3, :3]))
            assert distance_m > 2.0 or rotation_deg > 12.0


def test_a_map_smaller_than_the_scan_gives_no_candidates(rng: np.random.Generator) -> None:
    hills = Hills()
    whole = hills.map(rng, 0.4)
    small_map = whole[(np.abs(whole[:, 0]) < 1.0) & (np.abs(whole[:, 1]) < 1.0)]
    assert len(search(small_map, hills.scan(rng, hills.pose(0, 0, 0))).transforms) == 0


def test_a_scan_without_ground_is_refused(rng: np.random.Generator) -> None:
    distant_object = rng.normal([30.0, 0.0, 0.0], 1.0, (100, 3))
    with pytest.raises(RefusedError, match="of the robot"):
        search(Hills().map(rng, 0.5), distant_object)


def test_invalid_clouds_are_refused() -> None:
    with pytest.raises(InputError, match="map"):
        search(np.zeros((3, 2)), np.zeros((40, 3)))
