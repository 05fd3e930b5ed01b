# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normal distributions transform and robust kernels: robustness to outliers, and refused input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.registration_3d._cells import fit_cells
from cdff_core.dfns.registration_3d.interface import Registration3DInputs
from tests.support import surfaces

T_TRUE = se3.exp_se3([0.2, -0.15, 0.1, 0.01, -0.02, 0.04])


def error_m(implementation: str, source: Any, target: Any, **config: object) -> float:
    node = Registry.default().make_dfn("registration_3d", implementation)
    node.configure(config)
    out = node.process(Registration3DInputs(source=source, target=target))
    return float(np.linalg.norm(se3.log_se3(se3.inverse(T_TRUE) @ out.transform)[:3]))


@pytest.mark.parametrize("kernel", ["tukey", "huber", "cauchy", "geman_mcclure"])
def test_every_robust_kernel_tolerates_outliers_that_bias_least_squares(
    kernel: str, rng: np.random.Generator
) -> None:
    source, target = (surfaces.terrain(rng) for _ in range(2))
    source = se3.transform_points(se3.inverse(T_TRUE), source)
    source[:1200, 2] += rng.uniform(0.1, 0.4, 1200)
    robust = error_m("PointToPlaneIcp", source, target, kernel=kernel, kernel_gates=0.0)
    assert robust < 0.02
    assert robust < 0.5 * error_m("PointToPlaneIcp", source, target, kernel="none", kernel_gates=0.0)


def test_an_unknown_kernel_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="kernel"):
        Registry.default().make_dfn("registration_3d").configure({"kernel": "welsch"})


def test_ndt_tolerates_twenty_percent_of_outliers(rng: np.random.Generator) -> None:
    source = se3.transform_points(se3.inverse(T_TRUE), surfaces.terrain(rng))
    clutter = rng.uniform([-10, -10, 0.8], [10, 10, 2.0], (len(source) // 5, 3))
    assert error_m("Ndt", np.vstack([source, clutter]), surfaces.terrain(rng)) < 0.02


def test_ndt_ends_when_the_steps_are_within_the_tolerance(rng: np.random.Generator) -> None:
    source, target = (surfaces.terrain(rng) for _ in range(2))
    iterations = []
    for tolerance_m in (None, 10.0):
        node = Registry.default().make_dfn("registration_3d", "Ndt")
        node.configure({"tolerance_m": tolerance_m})
        iterations.append(node.process(Registration3DInputs(source=source, target=target)).iterations)
    assert iterations[1] < iterations[0]


def test_a_cell_has_the_mean_and_covariance_of_its_points_and_a_cell_of_collinear_points_is_dropped(
    rng: np.random.Generator,
) -> None:
    patch = rng.normal(size=(200, 3)) * [0.1, 0.1, 0.01] + [0.5, 0.5, 0.05]
    patch = np.clip(patch, 0.01, 0.99)
    line = np.c_[np.linspace(10.01, 10.99, 50), np.full(50, 10.5), np.full(50, 0.5)] + rng.normal(
        0, 1e-3, (50, 3)
    )
    points = np.vstack([[[0.0, 0.0, 0.0]], patch, line])
    cells = fit_cells(points, 1.0, 5, 1e-6)
    assert cells is not None
    assert len(cells.normals) == 1
    inside = points[:201]
    np.testing.assert_allclose(cells.tree.points[0], inside.mean(axis=0))
    np.testing.assert_allclose(np.linalg.inv(cells.information[0]), np.cov(inside.T, bias=True), atol=1e-9)


def test_a_target_too_sparse_for_cells_is_refused(rng: np.random.Generator) -> None:
    sparse = rng.uniform(-1000, 1000, (50, 3))
    with pytest.raises(DegenerateGeometryError, match="too sparse"):
        error_m("Ndt", sparse, sparse, cell_m=1.0)
