# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ElevationCorrelation: the right place is among the first, wherever the robot stands and looks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.place_search._interface import PlaceSearchInputs
from tests.mapped_hills import Hills


def searched(ground: np.ndarray, scan: np.ndarray, **config: object) -> Any:
    node = Registry.default().make_dfn("place_search")
    node.configure(config)
    return node.process(PlaceSearchInputs(ground, scan))


@pytest.mark.parametrize("seed", range(5))
def test_the_first_candidate_is_within_the_reach_of_a_registration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hills = Hills(seed)
    T = hills.pose(*rng.uniform(-20, 20, 2), rng.uniform(-np.pi, np.pi))
    out = searched(hills.map(rng, 0.4), hills.scan(rng, T))
    E = se3.inverse(T) @ out.transforms[0]
    assert np.linalg.norm(E[:3, 3]) < 2.0
    assert np.degrees(se3.rotation_angle(E[:3, :3])) < 15.0
    assert np.all(np.diff(out.residuals_m) >= 0.0)
    assert int(out.searched) > 10_000


def test_candidates_lie_apart(rng: np.random.Generator) -> None:
    hills = Hills()
    out = searched(hills.map(rng, 0.4), hills.scan(rng, hills.pose(0, 0, 0)), candidates=10)
    for i, A in enumerate(out.transforms):
        for B in out.transforms[:i]:
            away = np.linalg.norm(A[:3, 3] - B[:3, 3])
            turned = np.degrees(se3.rotation_angle(A[:3, :3].T @ B[:3, :3]))
            assert away > 2.0 or turned > 12.0


def test_a_map_that_does_not_cover_the_scan_has_no_candidates(rng: np.random.Generator) -> None:
    hills = Hills()
    ground = hills.map(rng, 0.4)
    strip = ground[(np.abs(ground[:, 0]) < 1.0) & (np.abs(ground[:, 1]) < 1.0)]
    assert len(searched(strip, hills.scan(rng, hills.pose(0, 0, 0))).transforms) == 0


def test_a_scan_without_ground_is_refused(rng: np.random.Generator) -> None:
    far = rng.normal([30.0, 0.0, 0.0], 1.0, (100, 3))
    with pytest.raises(RefusedError, match="of the robot"):
        searched(Hills().map(rng, 0.5), far)


def test_clouds_must_be_clouds() -> None:
    with pytest.raises(InputError, match="map"):
        searched(np.zeros((3, 2)), np.zeros((40, 3)))
