# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare elevation maps of built-up areas with the manually classified ground, by the size of the cells.

Both samples are airborne lidar of the ISPRS test with about one point per square metre. An elevation map of
all points is compared with the mean height of the ground points in each cell that has some. The maps
are rasterised with the rule of ``digital_elevation_mapping`` for their cell size, and, for comparison, with
vertical gaps at all sizes. The defaults of the ground filter were checked on the same samples.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.dem_rasterisation.interface import DemRasterisationInputs
from cdff_core.dfpcs.digital_elevation_mapping.structure_filter import StructureFilter
from evaluation.ground_segmentation import read_classified

PAGE = "digital_elevation_mapping"
SAMPLES = ("samp11", "samp42")
EDGES_M = (0.5, 1.0, 2.0, 4.0, 8.0)
RULES = ("vertical gaps", "rule of the DFPC")


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results by sample, cell size and rule."""
    report: dict[str, Any] = {}
    for name in SAMPLES:
        path = data / "isprs_terrain" / f"{name}-utm.pcd"
        points, is_ground = read_classified(path, path.with_name(f"{name}-utm-ground.pcd"))
        # Heights and positions of UTM coordinates are kept relative to the first cell.
        points = points - np.floor(points.min(axis=0))
        report[name] = {}
        for edge_m in EDGES_M:
            progress(f"overhangs: {name}, cells of {edge_m:g} m")
            report[name][f"{edge_m:g} m"] = {rule: errors(points, is_ground, edge_m, rule) for rule in RULES}
    return report


def errors(
    points: NDArray[np.float64], is_ground: NDArray[np.bool_], edge_m: float, rule: str
) -> dict[str, float]:
    """Return lost ground and remaining structure, percent of their points, and height errors, metres."""
    dfpc = Registry.default().make_dfpc("digital_elevation_mapping")
    dfpc.configure({"resolution_m": edge_m, "far_factor": 0}, DfpcContext("airborne"))
    rasterise = dfpc.dfn("rasterisation", resolution_m=edge_m, overhang_gap_m=dfpc.config.overhang_gap_m)
    is_structure = StructureFilter(dfpc.config, dfpc.dfn).find(points, edge_m) if rule == RULES[1] else None
    # The mean intensity of a cell is then its fraction of ground points.
    inputs = DemRasterisationInputs(
        points=points, intensity=is_ground.astype(np.float64), is_structure=is_structure
    )
    result = rasterise.process(inputs).map
    row, col, _ = result.geometry.cells_of(*points[:, :2].T)
    flat, shape = row * result.geometry.cols + col, result.geometry.shape
    ground_count, total = (
        np.bincount(flat[rows], minlength=shape[0] * shape[1]).reshape(shape)
        for rows in (is_ground, np.ones(len(points), np.bool_))
    )
    ground_sum = np.bincount(flat[is_ground], points[is_ground, 2], ground_count.size).reshape(shape)
    has_ground = ground_count > 0
    count = np.nan_to_num(result.layer("count"))
    kept_ground = count * np.nan_to_num(result.layer("intensity"))
    structure = (total - ground_count)[has_ground].sum()
    error_m = result.layer("mean")[has_ground] - ground_sum[has_ground] / ground_count[has_ground]
    return {
        "cells_with_ground": int(has_ground.sum()),
        "ground_lost_percent": round(100.0 * (1.0 - float(kept_ground.sum() / is_ground.sum())), 2),
        "structure_left_percent": round(
            100.0 * float((count - kept_ground)[has_ground].sum() / structure), 1
        ),
        "rmse_m": round(float(np.sqrt(np.mean(error_m**2))), 3),
        "bias_m": round(float(error_m.mean()), 3),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table: a row for each sample and cell size, with vertical gaps and the rule of the DFPC."""
    lines = [
        "| sample, cells | ground lost: vertical gaps, DFPC | structure left in cells with ground "
        "| RMSE | bias |",
        "|---" * 5 + "|",
    ]
    for name, sizes in figures.items():
        for size, rules in sizes.items():
            gaps, ours = (rules[rule] for rule in RULES)
            lines.append(
                f"| {name}, {size} "
                f"| {gaps['ground_lost_percent']:.2f} %, {ours['ground_lost_percent']:.2f} % "
                f"| {gaps['structure_left_percent']:.0f} %, {ours['structure_left_percent']:.0f} % "
                f"| {gaps['rmse_m']:.2f} m, {ours['rmse_m']:.2f} m "
                f"| {gaps['bias_m']:+.2f} m, {ours['bias_m']:+.2f} m |"
            )
    return "\n".join(lines)
