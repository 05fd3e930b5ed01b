# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare ground filtering of airborne lidar with manual classification, with one setting for all samples.

The errors are those of the ISPRS test [1]_. Type I: fraction of ground points classified as objects; type II:
fraction of object points classified as ground; total: fraction of all points with the wrong class; and
Cohen's kappa. The rows are the default setting, one grid instead of four, and the setting that the authors
of the method publish for all samples [2]_ (one grid, no maximum threshold).

References
----------
.. [1] Sithole, G., Vosselman, G. (2004). Experimental comparison of filter algorithms for bare-Earth
   extraction from airborne laser scanning point clouds. ISPRS Journal 59. doi:10.1016/j.isprsjprs.2004.05.004
.. [2] Pingel, T. J., Clarke, K. C., McBride, W. A. (2013). doi:10.1016/j.isprsjprs.2012.12.002
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.pcd import read_pcd
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.ground_segmentation.interface import GroundSegmentationInputs

SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "one grid": {"phases": 1},
    "published single setting": {
        "phases": 1,
        "cell_m": 1.0,
        "slope": 0.15,
        "window_m": 18.0,
        "max_step_m": 100.0,
        "tolerance_m": 0.5,
        "tolerance_per_slope_m": 1.25,
    },
}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors of each sample and their means for each setting, percent."""
    samples = {
        path.name.split("-")[0]: path for path in sorted((data / "isprs_terrain").glob("samp*-ground.pcd"))
    }
    report: dict[str, Any] = {}
    for setting, config in SETTINGS.items():
        node = Registry.default().make_dfn("ground_segmentation")
        node.configure(config)
        rows: dict[str, dict[str, float]] = {}
        for name, path in samples.items():
            progress(f"ground: {setting}, {name}")
            points, truth = read_classified(path.with_name(path.name.replace("-ground", "")), path)
            started = time.process_time()
            result = np.zeros(len(points), dtype=np.bool_)
            result[node.process(GroundSegmentationInputs(points=points)).ground] = True
            rows[name] = ground_errors(result, truth) | {"cpu_s": round(time.process_time() - started, 2)}
        rows["mean"] = {
            key: round(float(np.mean([row[key] for row in rows.values()])), 2) for key in rows[name]
        }
        report[setting] = rows
    return report


def read_classified(all_points: Path, ground_points: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the points ``(n, 3)`` of a sample, and True ``(n,)`` for points in the file of ground points."""
    points, truth = (
        np.asarray(read_pcd(path).points_m, dtype=np.float64) for path in (all_points, ground_points)
    )
    rows = {tuple(row) for row in truth.tolist()}
    return points, np.array([tuple(row) in rows for row in points.tolist()], dtype=np.bool_)


def ground_errors(estimate: NDArray[np.bool_], truth: NDArray[np.bool_]) -> dict[str, float]:
    """Return number of points, errors of type I and II and total error, percent, and kappa times 100.

    Estimated and true classes have the shape ``(n,)``; True is ground.
    """
    agreement = float(np.mean(estimate == truth))
    chance = float(estimate.mean() * truth.mean() + (1 - estimate.mean()) * (1 - truth.mean()))
    return {
        "points": len(truth),
        "type_1": round(100 * float(np.mean(~estimate[truth])), 2),
        "type_2": round(100 * float(np.mean(estimate[~truth])), 2),
        "total": round(100 * (1 - agreement), 2),
        "kappa": round(100 * (agreement - chance) / (1 - chance), 2),
    }
