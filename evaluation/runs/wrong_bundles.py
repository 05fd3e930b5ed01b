# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Degenerate and wrong cameras and observations for bundle adjustment and sparse triangulation (simulated).

In bundle adjustment two cameras are fixed at their true poses, so that errors and covariances have the same
gauge. The error is the 90 % quantile over the coordinates of the points, in stated standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import BundleProblem, LandmarkMap
from evaluation.runs.wrong_input import Case, field_error_sigmas
from evaluation.scenes.bundles import ring
from evaluation.triangulation import scene

SIMULATED = "simulated"
#: Poses (n, 4, 4), lens (4,), positions (p, 3) and pixels (m, 2) of a problem.
Parts = dict[str, FloatArray]


def _with_rows(name: str, rows: Any, value: Any) -> Callable[[Parts], Parts]:
    """Return a function that sets rows of a part to a value."""

    def change(parts: Parts) -> Parts:
        array = np.array(parts[name], np.float64)
        array[rows] = value
        return parts | {name: array}

    return change


def _focal(ratio: float) -> Callable[[Parts], Parts]:
    return lambda parts: parts | {"lens": parts["lens"] * [ratio, ratio, 1.0, 1.0]}


FAULTS: dict[str, Callable[[Parts], Parts]] = {
    "none": lambda parts: parts,
    "no points": lambda parts: parts | {"positions": parts["positions"][:0], "pixels": parts["pixels"][:0]},
    "1 % of the pixels NaN": _with_rows("pixels", slice(None, None, 100), np.nan),
    "1 % of the pixels infinite": _with_rows("pixels", slice(None, None, 100), np.inf),
    "1 % of the pixels at the corner": _with_rows("pixels", slice(None, None, 100), 0.0),
    "all pixels equal": _with_rows("pixels", slice(None), [300.0, 200.0]),
    "a pose NaN": _with_rows("poses", 1, np.nan),
    "all cameras at one place": lambda parts: (
        parts | {"poses": np.tile(parts["poses"][:1], (len(parts["poses"]), 1, 1))}
    ),
    "positions of 10⁹ m": lambda parts: parts | {"positions": parts["positions"] + 1e9},
    "focal length NaN": lambda parts: parts | {"lens": np.array([np.nan, 800.0, 0.0, 0.0])},
    "focal length 1 % too long": _focal(1.01),
    "focal length 3 % too long": _focal(1.03),
}


def cases(data: Path) -> Iterator[Case]:
    """Yield the cases of bundle_adjustment and of the port tracks of triangulation."""
    adjusted, true_poses, adjusted_truth = ring(8, 60, 6, 1.0, 0)
    triangulated, triangulated_truth = scene(3, (4.0, 30.0), 300)
    for fault, change in FAULTS.items():
        yield _case("bundle_adjustment", "problem", fault, change, adjusted, adjusted_truth, true_poses[:2])
        if fault not in ("positions of 10⁹ m", "a pose NaN"):
            yield _case("triangulation", "tracks", fault, change, triangulated, triangulated_truth)
    yield _case(
        "triangulation", "tracks", "a pose NaN", FAULTS["a pose NaN"], triangulated, triangulated_truth
    )


def _case(
    dfpc: str,
    port: str,
    fault: str,
    change: Callable[[Parts], Parts],
    problem: BundleProblem,
    truth: FloatArray,
    fixed_poses: FloatArray | None = None,
) -> Case:
    poses = problem.cameras.matrices.copy()
    is_fixed = np.zeros(len(poses), int)
    if fixed_poses is not None:
        poses[: len(fixed_poses)], is_fixed[: len(fixed_poses)] = fixed_poses, 1
    observations = problem.observations
    parts = {
        "poses": poses,
        "lens": np.array(problem.lenses.values)[0, :4],
        "positions": np.array(problem.points.positions),
        "pixels": np.array(observations.pixels[:, :2]),
    }

    def samples() -> list[Sample]:
        p = change(parts)
        count = len(p["pixels"])
        rows = (observations.cameras[:count], observations.points[:count])
        value = BundleProblem.from_arrays(
            p["poses"], p["lens"], p["positions"], rows, p["pixels"], frame="site", fixed=is_fixed.tolist()
        )
        return [Sample(port, 0, 0, value)]

    def error(value: LandmarkMap) -> float:
        sigmas = np.sqrt(np.einsum("nii->ni", value.covariances))
        return field_error_sigmas(value.data.positions - truth[value.data.ids], sigmas)

    return Case(dfpc, SIMULATED, f"{port}: {fault}", "landmarks", samples, error)
