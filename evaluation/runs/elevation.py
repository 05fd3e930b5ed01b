# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate elevation maps of many simulated drives with several pose sources, and the rules of atlaas."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.registry import Registry
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_dev.compare.elevation import compare
from cdff_dev.compare.error_summary import error_summary
from evaluation.peers.atlaas import AtlaasMap
from evaluation.runs.dead_reckoning import EPOCH_NS
from evaluation.runs.lidar import LEVELLED_S, LidarRun, lidar_run

#: Seeds of the drives; no parameter was chosen with them.
SEEDS = range(41_000, 41_012)
CONFIG = {"resolution_m": 0.05, "far_factor": 0, "fusion": {"size_m": 60.0}}

#: Error statistics of one map, by name.
Scores = dict[str, float]


def build_map(
    samples: Iterable[Sample], context: DfpcContext, variant: str, config: dict[str, Any]
) -> ElevationMap:
    """Return the local map after all samples."""
    dfpc = Registry.default().make_dfpc("digital_elevation_mapping")
    dfpc.configure(config, context, variant)
    for sample in samples:
        list(dfpc.step(sample))
    list(dfpc.finish())
    dem: ElevationMap = dfpc.call("get_map", {})
    return dem


def as_samples(products: Iterable[Product], port: str) -> list[Sample]:
    """Return products of a DFPC as samples for a port of another DFPC."""
    return [Sample(port, p.header.t1_ns, p.header.seq, p.value, quality=p.header.quality) for p in products]


def evaluate_drives(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results over all seeds for each pose source."""
    rows: dict[str, list[Scores]] = {}
    for seed in SEEDS:
        progress(f"dem: drive of seed {seed}")
        for name, scores in evaluate_drive(lidar_run(seed)).items():
            rows.setdefault(name, []).append(scores)
    true_pose_rows = rows["true poses"]
    return {
        "drives": len(SEEDS),
        "seeds": [SEEDS.start, SEEDS.stop - 1],
        "rows": {name: _summary(result, true_pose_rows) for name, result in rows.items()},
    }


def evaluate_drive(drive: LidarRun) -> dict[str, Scores]:
    """Return the error statistics of the maps of one drive; mapping starts at the first attitude fix."""
    start_ns = EPOCH_NS + round(LEVELLED_S * 1e9)
    sweeps = [s for s in drive.sweeps if s.value.t0_ns >= start_ns]
    estimated, levelled = drive.estimated_poses(), drive.estimated_poses(levelled=True)
    results = {
        "true poses": _elevation_map(drive, drive.true_poses(), sweeps),
        "estimated poses": _elevation_map(drive, estimated, sweeps),
        "estimated poses, attitude fixes": _elevation_map(drive, levelled, sweeps),
    }
    scores = {name: _scores(dem, drive.truth) for name, dem in results.items()}
    scores["estimated poses, map aligned"] = _scores(
        results["estimated poses"], drive.truth, remove_shift=True
    )
    scores["atlaas rules, attitude fixes"] = _scores(_atlaas(drive, levelled, sweeps), drive.truth)
    return scores


def _elevation_map(drive: LidarRun, poses: list[Sample], sweeps: list[Sample]) -> ElevationMap:
    config = {**CONFIG, "range_sigma_m": drive.range_sigma_m}
    return build_map(_in_time_order([*poses, *sweeps]), drive.drive.context, "Lidar", config)


def _atlaas(drive: LidarRun, poses: list[Sample], sweeps: list[Sample]) -> ElevationMap:
    """Return the map of sweeps that are rasterised separately, without error model, and fused by atlaas's
    rules.
    """
    node = Registry.default().make_dfpc("digital_elevation_mapping")
    no_error_model = {
        "align": False,
        "range_sigma_m": 0.0,
        "max_rays": 0,
        "patch_period_s": 1e-3,
        "overhang_gap_m": None,
    }
    node.configure({**CONFIG, **no_error_model}, drive.drive.context, "Lidar")
    atlaas_map = AtlaasMap(drive.truth.geometry)

    def merge_maps(outputs: Iterable[Output]) -> None:
        for output in outputs:
            if output.port == "map" and output.value is not None:
                atlaas_map.merge(output.value, drive.drive.truth(output.t1_ns)[:2, 3])

    for sample in _in_time_order([*(_without_covariance(p) for p in poses), *sweeps]):
        merge_maps(node.step(sample))
    merge_maps(node.finish())
    return atlaas_map.to_map(EPOCH_NS)


def _without_covariance(pose: Sample) -> Sample:
    estimate: TransformWithCovariance = pose.value
    value = TransformWithCovariance.from_transform(
        UncertainTransform.exact(estimate.transform.matrix),
        parent=estimate.parent_frame,
        child=estimate.child_frame,
        stamp_ns=estimate.stamp_ns,
    )
    return Sample(pose.port, pose.stamp_ns, pose.seq, value)


def _in_time_order(samples: list[Sample]) -> list[Sample]:
    return sorted(samples, key=lambda s: (s.stamp_ns, s.port))


def _scores(dem: ElevationMap, truth: ElevationMap, *, remove_shift: bool = False) -> Scores:
    comparison = compare(dem, truth, remove_shift=remove_shift)
    return {
        name: float(comparison[name]) for name in ("bias_m", "rmse_m", "nmad_m", "within_90_percent", "cells")
    }


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _summary(rows: list[Scores], true_pose_rows: list[Scores]) -> dict[str, Any]:
    """Return the statistics over all drives; the RMSE ratio is relative to maps with true poses."""
    within_90 = np.array([s["within_90_percent"] for s in rows])
    rmse_ratio = _rms([s["rmse_m"] for s in rows]) / _rms([s["rmse_m"] for s in true_pose_rows])
    return {
        "bias_m": error_summary([abs(s["bias_m"]) for s in rows], 5),
        "bias_rms_m": round(_rms([s["bias_m"] for s in rows]), 5),
        "rmse_m": error_summary([s["rmse_m"] for s in rows], 5),
        "nmad_m": error_summary([s["nmad_m"] for s in rows], 5),
        "rmse_ratio": round(rmse_ratio, 3),
        "cells": error_summary([s["cells"] for s in rows], 0),
        "within_90_percent": {
            "mean": round(float(within_90.mean()), 4),
            "min": round(float(within_90.min()), 4),
            "max": round(float(within_90.max()), 4),
            "standard_error": round(float(within_90.std(ddof=1) / np.sqrt(len(within_90))), 4),
        },
    }
