# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every implementation of Registration3D converges, is repeatable, and refuses invalid input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.registration_3d.interface import Registration3DInputs
from tests.support import surfaces

IMPLEMENTATIONS = ("PointToPlaneIcp", "Gicp", "Ndt")
T_TRUE = se3.exp_se3([0.4, -0.3, 0.2, 0.02, -0.03, 0.08])


def make_node(implementation: str, **config: object) -> Any:
    node = Registry.default().make_dfn("registration_3d", implementation)
    node.configure(config)
    return node


@pytest.fixture
def clouds(rng: np.random.Generator) -> tuple[surfaces.Points, surfaces.Points]:
    target = surfaces.terrain(rng)
    return se3.transform_points(se3.inverse(T_TRUE), surfaces.terrain(rng)), target


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_terrain_is_registered_from_the_identity(implementation: str, clouds: tuple[Any, Any]) -> None:
    outputs = make_node(implementation).process(Registration3DInputs(source=clouds[0], target=clouds[1]))
    error = se3.log_se3(se3.inverse(T_TRUE) @ outputs.transform)
    assert outputs.converged
    assert np.linalg.norm(error[:3]) < 0.01
    assert np.linalg.norm(error[3:]) < 0.002
    assert 0.005 < outputs.residual_scale_m < 0.05


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_the_same_clouds_give_the_same_transform_bit_for_bit(
    implementation: str, clouds: tuple[Any, Any]
) -> None:
    node = make_node(implementation)
    first, second = (
        node.process(Registration3DInputs(source=clouds[0], target=clouds[1])).transform for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_clouds_far_from_the_origin_are_registered_equally_well(
    implementation: str, clouds: tuple[Any, Any]
) -> None:
    T_utm_local = se3.transform(np.eye(3), [5e5, 4e6, 100.0])  # coordinates of the size of UTM
    source, target = (se3.transform_points(T_utm_local, cloud) for cloud in clouds)
    outputs = make_node(implementation).process(Registration3DInputs(source=source, target=target))
    T = se3.inverse(T_utm_local) @ outputs.transform @ T_utm_local
    assert np.linalg.norm(se3.log_se3(se3.inverse(T_TRUE) @ T)[:3]) < 0.02


def test_twenty_percent_of_outliers_do_not_affect_point_to_plane(
    rng: np.random.Generator, clouds: tuple[Any, Any]
) -> None:
    source, target = clouds
    clutter = rng.uniform([-10, -10, 0.5], [10, 10, 2.0], (len(source) // 5, 3))
    outputs = make_node("PointToPlaneIcp").process(
        Registration3DInputs(source=np.vstack([source, clutter]), target=target)
    )
    assert np.linalg.norm(se3.log_se3(se3.inverse(T_TRUE) @ outputs.transform)[:3]) < 0.02


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_clouds_without_correspondences_within_the_gate_are_refused(
    implementation: str, clouds: tuple[Any, Any]
) -> None:
    source, target = clouds
    with pytest.raises(DegenerateGeometryError, match="within"):
        make_node(
            implementation,
            max_distance_m=0.1,
            **({"first_distance_m": 0.1} if implementation[0] == "P" else {}),
        ).process(Registration3DInputs(source=source + 1000.0, target=target))


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_malformed_inputs_are_refused_with_their_name(implementation: str, clouds: tuple[Any, Any]) -> None:
    source, target = clouds
    node = make_node(implementation)
    with pytest.raises(InputError, match="source"):
        node.process(Registration3DInputs(source=source[:, :2], target=target))
    with pytest.raises(InputError, match="not finite"):
        node.process(Registration3DInputs(source=np.where(source > 9, np.nan, source), target=target))
    with pytest.raises(InputError, match="guess"):
        node.process(Registration3DInputs(source=source, target=target, guess=np.zeros((4, 4))))
    with pytest.raises(InputError, match="at least"):
        node.process(Registration3DInputs(source=source[:3], target=target))
    with pytest.raises(ConfigurationError, match="max_iterations"):
        node.configure({"max_iterations": 0})
