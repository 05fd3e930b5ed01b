# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every implementation of Registration3D: converges, is repeatable, and says what it cannot use."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.registration_3d._interface import Registration3DInputs
from tests import surfaces

IMPLEMENTATIONS = ("PointToPlaneIcp", "Gicp", "Ndt")
T_TRUE = se3.exp_se3([0.4, -0.3, 0.2, 0.02, -0.03, 0.08])


def made(implementation: str, **config: object) -> Any:
    node = Registry.default().make_dfn("registration_3d", implementation)
    node.configure(config)
    return node


@pytest.fixture
def clouds(rng: np.random.Generator) -> tuple[surfaces.Points, surfaces.Points]:
    target = surfaces.terrain(rng)
    return se3.transform_points(se3.inverse(T_TRUE), surfaces.terrain(rng)), target


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_terrain_is_aligned_from_the_identity(implementation: str, clouds: tuple[Any, Any]) -> None:
    out = made(implementation).process(Registration3DInputs(*clouds))
    error = se3.log_se3(se3.inverse(T_TRUE) @ out.transform)
    assert bool(out.converged)
    assert np.linalg.norm(error[:3]) < 0.01
    assert np.linalg.norm(error[3:]) < 0.002
    assert 0.005 < float(out.residual_scale_m) < 0.05


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_the_same_clouds_give_the_same_transform_bit_for_bit(implementation: str, clouds: tuple[Any, Any]) -> None:
    node = made(implementation)
    first, second = (node.process(Registration3DInputs(*clouds)).transform for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_clouds_far_from_their_origin_are_aligned_as_well(implementation: str, clouds: tuple[Any, Any]) -> None:
    away = se3.transform(np.eye(3), [5e5, 4e6, 100.0])  # UTM coordinates
    source, target = (se3.transform_points(away, cloud) for cloud in clouds)
    out = made(implementation).process(Registration3DInputs(source, target))
    T = se3.inverse(away) @ out.transform @ away
    assert np.linalg.norm(se3.log_se3(se3.inverse(T_TRUE) @ T)[:3]) < 0.02


def test_a_fifth_of_wrong_points_does_not_pull_point_to_plane_away(
    rng: np.random.Generator, clouds: tuple[Any, Any]
) -> None:
    source, target = clouds
    clutter = rng.uniform([-10, -10, 0.5], [10, 10, 2.0], (len(source) // 5, 3))
    out = made("PointToPlaneIcp").process(Registration3DInputs(np.vstack([source, clutter]), target))
    assert np.linalg.norm(se3.log_se3(se3.inverse(T_TRUE) @ out.transform)[:3]) < 0.02


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_clouds_without_a_common_point_within_the_gate_are_refused(
    implementation: str, clouds: tuple[Any, Any]
) -> None:
    source, target = clouds
    with pytest.raises(DegenerateGeometryError, match="within"):
        made(
            implementation, max_distance_m=0.1, **({"first_distance_m": 0.1} if implementation[0] == "P" else {})
        ).process(Registration3DInputs(source + 1000.0, target))


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_malformed_inputs_are_named(implementation: str, clouds: tuple[Any, Any]) -> None:
    source, target = clouds
    node = made(implementation)
    with pytest.raises(InputError, match="source"):
        node.process(Registration3DInputs(source[:, :2], target))
    with pytest.raises(InputError, match="not finite"):
        node.process(Registration3DInputs(np.where(source > 9, np.nan, source), target))
    with pytest.raises(InputError, match="guess"):
        node.process(Registration3DInputs(source, target, guess=np.zeros((4, 4))))
    with pytest.raises(InputError, match="at least"):
        node.process(Registration3DInputs(source[:3], target))
    with pytest.raises(ConfigurationError, match="max_iterations"):
        node.configure({"max_iterations": 0})
