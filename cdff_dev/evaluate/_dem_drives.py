# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation maps of many simulated drives: errors by poses, coverage of intervals, atlaas's rules beside ours."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.registry import Registry
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_dev.elevation import compare
from cdff_dev.evaluate._atlaas import AtlaasMap
from cdff_dev.evaluate._dead_reckoning import EPOCH_NS
from cdff_dev.evaluate._lidar_drives import LEVELLED_S, LidarDrive, lidar_drive
from cdff_dev.evaluate.record import spread

#: None of them served to choose anything.
SEEDS = range(41_000, 41_012)
CONFIG = {"resolution_m": 0.05, "far_factor": 0, "fusion": {"size_m": 60.0}}

#: Figures of one map.
Scores = dict[str, float]


def mapped(samples: Iterable[Sample], context: DfpcContext, variant: str, config: dict[str, Any]) -> ElevationMap:
    """The local map after all samples."""
    node = Registry.default().make_dfpc("digital_elevation_mapping")
    node.configure(config, context, variant)
    for sample in samples:
        list(node.step(sample))
    list(node.finish())
    dem: ElevationMap = node.call("get_map", {})
    return dem


def as_samples(products: Iterable[Product], port: str) -> list[Sample]:
    """Products of a DFPC as samples of another's port."""
    return [Sample(port, p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality) for p in products]


def of_drives(progress: Callable[[str], None]) -> dict[str, Any]:
    """Figures over all seeds, by the poses that were given."""
    rows: dict[str, list[Scores]] = {}
    for seed in SEEDS:
        progress(f"dem: drive of seed {seed}")
        for name, scores in of_drive(lidar_drive(seed)).items():
            rows.setdefault(name, []).append(scores)
    best = rows["true poses"]
    return {
        "drives": len(SEEDS),
        "seeds": [SEEDS.start, SEEDS.stop - 1],
        "rows": {name: _over(found, best) for name, found in rows.items()},
    }


def of_drive(drive: LidarDrive) -> dict[str, Scores]:
    """Figures of one drive's maps; where the attitude is told it is mapped from then on, with true poses too."""
    begin_ns = EPOCH_NS + round(LEVELLED_S * 1e9)
    sweeps = [s for s in drive.sweeps if s.value.t0_ns >= begin_ns]
    estimated, levelled = drive.estimated_poses(), drive.estimated_poses(levelled=True)
    made = {
        "true poses": _map(drive, drive.true_poses(), sweeps),
        "estimated poses": _map(drive, estimated, sweeps),
        "estimated, attitude told": _map(drive, levelled, sweeps),
    }
    scores = {name: _scores(dem, drive.truth) for name, dem in made.items()}
    scores["estimated, less shift and tilt"] = _scores(made["estimated poses"], drive.truth, remove_shift=True)
    scores["atlaas's rules, attitude told"] = _scores(_atlaas(drive, levelled, sweeps), drive.truth)
    return scores


def _map(drive: LidarDrive, poses: list[Sample], sweeps: list[Sample]) -> ElevationMap:
    config = {**CONFIG, "range_sigma_m": drive.range_sigma_m}
    return mapped(_in_time([*poses, *sweeps]), drive.travel.context, "Lidar", config)


def _atlaas(drive: LidarDrive, poses: list[Sample], sweeps: list[Sample]) -> ElevationMap:
    """The same sweeps, each rasterised on its own without any model of errors, merged by atlaas's rules."""
    node = Registry.default().make_dfpc("digital_elevation_mapping")
    bare = {"align": False, "range_sigma_m": 0.0, "max_rays": 0, "patch_period_s": 1e-3, "overhang_gap_m": None}
    node.configure({**CONFIG, **bare}, drive.travel.context, "Lidar")
    merged = AtlaasMap(drive.truth.geometry)

    def take(outputs: Iterable[Output]) -> None:
        for output in outputs:
            if output.port == "map" and output.value is not None:
                merged.merge(output.value, drive.travel.truth(output.t1_ns)[:2, 3])

    for sample in _in_time([*(_certain(p) for p in poses), *sweeps]):
        take(node.step(sample))
    take(node.finish())
    return merged.to_map(EPOCH_NS)


def _certain(pose: Sample) -> Sample:
    given: TransformWithCovariance = pose.value
    value = TransformWithCovariance.from_transform(
        UncertainTransform(given.transform.matrix, np.zeros((6, 6))), parent=given.parent_frame,
        child=given.child_frame, stamp_ns=given.stamp_ns,
    )  # fmt: skip
    return Sample(pose.port, pose.stamp_ns, pose.seq, value)


def _in_time(samples: list[Sample]) -> list[Sample]:
    return sorted(samples, key=lambda s: (s.stamp_ns, s.port))


def _scores(dem: ElevationMap, truth: ElevationMap, *, remove_shift: bool = False) -> Scores:
    found = compare(dem, truth, remove_shift=remove_shift)
    return {name: float(found[name]) for name in ("bias_m", "rmse_m", "nmad_m", "within_90_percent", "cells")}


def _over(found: list[Scores], best: list[Scores]) -> dict[str, Any]:
    """Of all drives; the ratio is that of the root mean squares over all of them."""
    inside = np.array([s["within_90_percent"] for s in found])
    rms = {id(rows): np.sqrt(np.mean([s["rmse_m"] ** 2 for s in rows])) for rows in (found, best)}
    return {
        "bias_m": spread([abs(s["bias_m"]) for s in found], 5),
        "bias_rms_m": round(float(np.sqrt(np.mean([s["bias_m"] ** 2 for s in found]))), 5),
        "rmse_m": spread([s["rmse_m"] for s in found], 5),
        "nmad_m": spread([s["nmad_m"] for s in found], 5),
        "rmse_ratio": round(float(rms[id(found)] / rms[id(best)]), 3),
        "cells": spread([s["cells"] for s in found], 0),
        "within_90_percent": {
            "mean": round(float(inside.mean()), 4), "min": round(float(inside.min()), 4),
            "max": round(float(inside.max()), 4),
            "standard_error": round(float(inside.std(ddof=1) / np.sqrt(len(inside))), 4),
        },
    }  # fmt: skip
