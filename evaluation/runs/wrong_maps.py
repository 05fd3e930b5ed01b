# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Degenerate and wrong elevation maps for the DFPCs that use them, on simulated ground.

A navigation map has no standard deviation: its error is infinite if a cell that is a hazard is rated safe.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap, TransformWithCovariance
from evaluation.absolute_localisation import DATUM_M, FIX_PATH_LENGTH_M
from evaluation.runs.wrong_input import Case, last_value, pose_error_sigmas
from evaluation.scenes.orbital import Ground, PatchRun

SIMULATED = "simulated ground"
_SEED = 3000
#: Classes of a navigation map.
_SAFE, _HAZARD = 1, 3

Heights = NDArray[np.float32]


def _with_values(value: float, fraction: float) -> Callable[[Heights], Heights]:
    def change(heights: Heights) -> Heights:
        changed = heights.copy()
        changed[np.random.default_rng(0).random(heights.shape) < fraction] = value
        return changed

    return change


FAULTS: dict[str, Callable[[Heights], Heights]] = {
    "none": lambda z: z,
    "all NaN": _with_values(np.nan, 2.0),
    "1 % infinite": _with_values(np.inf, 0.01),
    "1 % at 10⁹ m": _with_values(1e9, 0.01),
    "plane": lambda z: np.where(np.isfinite(z), 0.0, z).astype(np.float32),
    "offset of 10⁹ m": lambda z: (z + np.float32(1e9)).astype(np.float32),
    "offset of 10⁶ m": lambda z: (z + np.float32(1e6)).astype(np.float32),
}


def cases(data: Path) -> Iterator[Case]:
    """Yield the cases of navigation_mapping and absolute_localisation."""
    ground = Ground.make(_SEED // 4)
    rated = last_value("navigation_mapping", [_terrain(ground, FAULTS["none"])], _ROVER, "navigation_map")
    for fault, change in FAULTS.items():
        if fault != "plane":
            yield _navigation(ground, fault, change, rated)
        for port in ("dem", "orbital"):
            yield _localisation(ground, port, fault, change)


_ROVER = DfpcContext(
    "mana", limits={"max_slope_deg": 8.0, "max_step_m": 0.2, "length_m": 1.0, "width_m": 0.8}
)


def _terrain(ground: Ground, change: Callable[[Heights], Heights]) -> Sample:
    """Return 40 m of the ground as a patch."""
    heights = ground.heights_m[300:500, 300:500].astype(np.float32)
    geometry = GridGeometry("site", 0.2, 0.0, 40.0, *heights.shape)
    mean = change(heights)
    observed = np.isfinite(mean)
    layers = dict.fromkeys(("mean", "min", "max"), mean)
    layers |= {"variance": np.where(observed, np.float32(1e-4), np.float32(np.nan))}
    layers |= {
        "count": (4 * observed).astype(np.int32),
        "age_s": np.where(observed, np.float32(0), np.float32(np.nan)),
    }
    dem = ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)
    return Sample("dem", 0, 0, dem)


def _navigation(
    ground: Ground, fault: str, change: Callable[[Heights], Heights], truth: NavigationMap
) -> Case:
    def error(value: NavigationMap) -> float:
        if value.geometry != truth.geometry:
            return float("inf")
        is_missed = (truth.layer("class") == _HAZARD) & (value.layer("class") == _SAFE)
        return float("inf") if is_missed.any() else 0.0

    return Case(
        "navigation_mapping",
        SIMULATED,
        f"dem: {fault}",
        "navigation_map",
        lambda: [_terrain(ground, change)],
        error,
        _ROVER,
    )


def _changed(dem: ElevationMap, change: Callable[[Heights], Heights]) -> ElevationMap:
    layers = {name: dem.layer(name) for name in dem.layer_names}
    layers["mean"] = change(layers["mean"])
    return ElevationMap.from_layers(dem.geometry, layers, t0_ns=dem.t0_ns, t1_ns=dem.t1_ns)


def drive(ground: Ground) -> tuple[list[Sample], Callable[[TransformWithCovariance], float]]:
    """Return the samples of a drive on an orbital model, and the error of a pose in standard deviations.

    The error of T_orbital_map (without usable poses) is that at the patch of the same time.
    """
    run = PatchRun.make(ground, _SEED, FIX_PATH_LENGTH_M)
    samples = [Sample("orbital", 0, 0, ground.orbital(_SEED, DATUM_M)), *run.samples(ground, _SEED)]
    stamps = np.array([s.stamp_ns for s in samples if s.port == "poses"])

    def error(value: TransformWithCovariance) -> float:
        index = int(np.argmin(np.abs(stamps - value.stamp_ns)))
        T_true = run.true_poses[index].copy()
        T_true[2, 3] += DATUM_M
        if not value.child_frame.endswith("/base"):
            T_true = T_true @ np.linalg.inv(run.estimated_poses[index])
        return pose_error_sigmas(T_true)(value)

    return samples, error


def _localisation(ground: Ground, port: str, fault: str, change: Callable[[Heights], Heights]) -> Case:
    samples, error = drive(ground)

    def faulty() -> list[Sample]:
        return [_with_change(s, change) if s.port == port else s for s in samples]

    return Case(
        "absolute_localisation", SIMULATED, f"{port}: {fault}", "pose", faulty, error, DfpcContext("mana")
    )


def _with_change(sample: Sample, change: Callable[[Heights], Heights]) -> Sample:
    value: Any = _changed(sample.value, change)
    return Sample(sample.port, sample.stamp_ns, sample.seq, value)
