# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Figure of an elevation map, the true terrain, and the errors of the map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cdff_common.plots import new_figure
from cdff_common.plots.drawing import colour_range, draw_differences, draw_heights
from cdff_dev.compare.elevation.compare import MapErrors

#: Quantile of the absolute errors at the ends of the histogram, and its number of bins.
_SHOWN, _BINS = 0.99, 60


def draw(errors: MapErrors, results: Mapping[str, Any]) -> Any:
    """Return a ``matplotlib.figure.Figure``: both maps, the error of each cell, and their distribution.

    ``results`` are those of ``accuracy_of``.
    """
    figure = new_figure(11.0, 8.4)
    (map_axes, true_axes), (error_axes, histogram) = figure.subplots(2, 2)
    limits_m = colour_range(errors.mean)
    draw_heights(figure, map_axes, errors.mean, errors.geometry, limits_m)
    map_axes.set_title("map")
    draw_heights(figure, true_axes, errors.true, errors.geometry, limits_m)
    true_axes.set_title("true terrain")
    draw_differences(figure, error_axes, errors.error, errors.geometry, "map - truth, m")
    error_axes.set_title("error" + (" after removal of the shift" if errors.is_shifted else ""))
    finite_errors = errors.error[np.isfinite(errors.error)]
    limit_m = float(np.quantile(np.abs(finite_errors), _SHOWN)) or 1e-6
    histogram.hist(finite_errors, bins=_BINS, range=(-limit_m, limit_m), color="C0")
    for value_m in (-results["le90_m"], results["le90_m"]):
        histogram.axvline(value_m, color="C3", lw=1.0, ls="--", label="LE90" if value_m > 0.0 else None)
    histogram.axvline(results["bias_m"], color="black", lw=1.0, label="bias")
    histogram.set(xlabel="map - truth, m", ylabel="cells")
    histogram.set_title(
        f"{results['cells']} cells: RMSE {results['rmse_m']:.3f} m, NMAD {results['nmad_m']:.3f} m, "
        f"LE90 {results['le90_m']:.3f} m",
        fontsize=10,
    )
    histogram.legend(fontsize=8)
    return figure
