# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelPoseSearch: the true pose is among the hypotheses, distinct and ordered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.model_pose_search.interface import ModelPoseSearchInputs
from cdff_core.dfns.model_pose_search.multi_start import MultiStart
from tests.support import satellite
from tests.support.prepared_satellite import prepared, surface_ports


def inputs(scan: np.ndarray) -> ModelPoseSearchInputs:
    model = prepared()
    return ModelPoseSearchInputs(
        scan=scan,
        view_directions=model.view_directions,
        view_centroids=model.view_centroids,
        sigma_m=0.01,
        **surface_ports(),
    )


def search(scan: np.ndarray, **config: int) -> tuple[np.ndarray, np.ndarray]:
    node = MultiStart()
    node.configure(config)
    outputs = node.process(inputs(scan))
    return outputs.poses, outputs.costs


def scan_at(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return satellite.scan(satellite.satellite(), T, pixels=64, field_deg=20.0, sigma_m=0.01, rng=rng)


def test_the_pose_is_among_the_first_hypotheses(rng: np.random.Generator) -> None:
    for _ in range(4):
        T = satellite.random_pose(rng, 5.0)
        poses, costs = search(scan_at(T, rng))
        assert (np.diff(costs) >= 0.0).all()
        angles = np.degrees(se3.rotation_angle(np.swapaxes(poses[:10, :3, :3], 1, 2) @ T[:3, :3]))
        best = int(np.argmin(angles))
        assert angles[best] < 2.0
        assert np.linalg.norm(poses[best, :3, 3] - T[:3, 3]) < 0.03


def test_hypotheses_are_rigid_and_limited_in_number(rng: np.random.Generator) -> None:
    poses, _ = search(scan_at(satellite.random_pose(rng, 5.0), rng), hypotheses=7)
    assert len(poses) == 7
    assert se3.are_transforms(poses).all()


def test_wrong_inputs_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="5 points"):
        search(rng.normal(size=(5, 3)))
    good = inputs(rng.normal(size=(50, 3)))
    with pytest.raises(InputError, match="normals"):
        replace(good, normals=good.normals[:10])
    with pytest.raises(InputError, match="scan"):
        replace(good, scan=np.full((50, 3), np.nan))
    with pytest.raises(InputError, match="sigma_m"):
        replace(good, sigma_m=0.0)
