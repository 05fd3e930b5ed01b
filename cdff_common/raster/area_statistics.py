# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of the heights and slopes of an area, with the error of the mean height and of the volume."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

#: Percentiles of the distributions.
PERCENTILES = (5, 25, 50, 75, 95)


def distribution(values: Float) -> dict[str, float] | None:
    """Return mean, standard deviation, extremes and percentiles of finite values ``(n,)``; None of none."""
    if not values.size:
        return None
    percentiles = np.percentile(values, PERCENTILES)
    return {
        "mean": float(values.mean()),
        "std": float(values.std()),
        "min": float(values.min()),
        "max": float(values.max()),
        **{f"p{p}": float(v) for p, v in zip(PERCENTILES, percentiles, strict=True)},
    }


def mean_error_m(noise_m2: Float, shared_m2: Float) -> float | None:
    """Return the standard deviation of the mean height of cells ``(n,)``; None where any error is unknown.

    The noise of the cells is independent; the errors of the poses are taken as common to all cells, which
    never states too small an error.
    """
    if not noise_m2.size or not (np.isfinite(noise_m2).all() and np.isfinite(shared_m2).all()):
        return None
    common = float(np.mean(np.sqrt(shared_m2))) ** 2
    return float(np.sqrt(noise_m2.sum() / noise_m2.size**2 + common))


def height_statistics(
    heights_m: Float, noise_m2: Float, shared_m2: Float, cell_m: float, datum_m: float | None
) -> dict[str, Any]:
    """Return the statistics of observed heights ``(n,)``.

    Parameters
    ----------
    noise_m2, shared_m2 : Float, shape (n,)
        Variance of the heights without, and of, the part that cells share; NaN where unknown.
    cell_m : float
        Edge of a cell.
    datum_m : float or None
        Height of the plane of the volume; None for the lowest height.
    """
    area = heights_m.size * cell_m**2
    error = mean_error_m(noise_m2, shared_m2)
    result: dict[str, Any] = {
        "cells": int(heights_m.size),
        "area_m2": area,
        "height_m": distribution(heights_m),
        "mean_sigma_m": error,
    }
    if heights_m.size:
        datum = float(heights_m.min()) if datum_m is None else datum_m
        above = heights_m - datum
        result |= {
            "datum_m": datum,
            "volume_above_m3": float(above[above > 0.0].sum()) * cell_m**2,
            "volume_below_m3": float(-above[above < 0.0].sum()) * cell_m**2,
            "volume_sigma_m3": None if error is None else error * area,
        }
    return result
