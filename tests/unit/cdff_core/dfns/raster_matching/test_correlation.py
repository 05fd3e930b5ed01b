# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correlation of masked fields at all translations against sums over the common cells."""

from __future__ import annotations

import numpy as np

from cdff_core.dfns.raster_matching._correlation import correlation, transform_field

SHAPE = (14, 15)


def field(rng: np.random.Generator, rows: int, cols: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the two components of a field with holes and a mean."""
    x, y = rng.normal(0.5, 1.0, (rows, cols)), rng.normal(-1.0, 2.0, (rows, cols))
    hole = rng.random((rows, cols)) < 0.3
    x[hole] = y[hole] = np.nan
    return x, y


def padded(values: np.ndarray) -> np.ndarray:
    out = np.full(SHAPE, np.nan)
    out[: values.shape[0], : values.shape[1]] = values
    return out


def expected(template: tuple[np.ndarray, ...], reference: tuple[np.ndarray, ...], least: float) -> np.ndarray:
    out = np.full(SHAPE, np.nan)
    f = np.stack([padded(c) for c in template])
    for shift in np.ndindex(SHAPE):
        g = np.roll(np.stack([padded(c) for c in reference]), (-shift[0], -shift[1]), axis=(1, 2))
        common = np.isfinite(f[0]) & np.isfinite(g[0])
        if common.sum() < least:
            continue
        a, b = f[:, common], g[:, common]
        a, b = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=1, keepdims=True)
        out[shift] = (a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum())
    return out


def test_the_correlation_at_each_translation_is_that_of_the_common_cells(rng: np.random.Generator) -> None:
    template, reference = field(rng, 5, 6), field(rng, 9, 8)
    result = correlation(transform_field(template, SHAPE), transform_field(reference, SHAPE), SHAPE, 4.0)
    np.testing.assert_allclose(result, expected(template, reference, 4), atol=1e-9)
    assert 20 < np.isfinite(result).sum() < result.size


def test_a_copy_has_the_correlation_one_at_its_translation(rng: np.random.Generator) -> None:
    reference = field(rng, 9, 8)
    template = tuple(c[3:8, 2:7] for c in reference)
    result = correlation(transform_field(template, SHAPE), transform_field(reference, SHAPE), SHAPE, 8.0)
    assert np.unravel_index(np.nanargmax(result), SHAPE) == (3, 2)
    assert abs(result[3, 2] - 1.0) < 1e-12
    opposite = tuple(-3.0 * c + 7.0 for c in template)
    result = correlation(transform_field(opposite, SHAPE), transform_field(reference, SHAPE), SHAPE, 8.0)
    assert abs(result[3, 2] + 1.0) < 1e-12


def test_fields_without_variation_have_no_correlation(rng: np.random.Generator) -> None:
    flat = np.full((5, 6), 2.0), np.full((5, 6), -1.0)
    reference = field(rng, 9, 8)
    for a, b in ((flat, reference), (reference, flat)):
        result = correlation(transform_field(a, SHAPE), transform_field(b, SHAPE), SHAPE, 1.0)
        assert np.nanmax(np.abs(result), initial=0.0) < 1e-6
