# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sampson distances: first-order distances of shifted pairs, and derivatives by differences."""

from __future__ import annotations

import numpy as np

from cdff_core.imaging.sampson import sampson, sampson_derivative

#: Rows of both images correspond: ``v = y``.
F_ROWS = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def test_a_row_offset_is_distributed_over_both_images(rng: np.random.Generator) -> None:
    source = rng.uniform(0.0, 500.0, (50, 2))
    sink = source + np.stack([rng.uniform(0.0, 20.0, 50), np.full(50, 2.0)], axis=1)
    np.testing.assert_allclose(np.abs(sampson(F_ROWS, source, sink)), 2.0 / np.sqrt(2.0))


def test_the_derivative_is_that_of_the_distance(rng: np.random.Generator) -> None:
    F, source, sink = (
        rng.normal(size=(3, 3)),
        rng.uniform(-1.0, 1.0, (20, 2)),
        rng.uniform(-1.0, 1.0, (20, 2)),
    )
    steps = 1e-6 * np.eye(9).reshape(9, 3, 3)
    differences = [sampson(F + d, source, sink) - sampson(F - d, source, sink) for d in steps]
    expected = np.stack(differences, axis=1) / 2e-6
    np.testing.assert_allclose(sampson_derivative(F, source, sink)[:, 0], expected, rtol=1e-5, atol=1e-7)


def test_a_pair_of_epipoles_has_the_distance_zero() -> None:
    origin = np.zeros((1, 2))
    assert sampson(np.diag([1.0, 1.0, 0.0]), origin, origin)[0] == 0.0
