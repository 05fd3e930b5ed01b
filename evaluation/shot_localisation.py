# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare SHOT with FPFH on the same keypoints and radii, and localise models in measured scenes.

A trial is a source keypoint that has a target keypoint within 1.5 voxels of its true position. Recall is the
fraction of trials whose mutual match is within this distance. Clouds are downsampled to 8 000 points. FPFH
uses the sign of the normals, SHOT does not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, nearest
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.voxels import voxel_for, voxel_means
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from cdff_core.dfns.features_description_3d.interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_extraction_3d.interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_matching_3d.interface import FeaturesMatching3DInputs
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from cdff_dev.compare.registration.rates import interval, pose_errors, rate_text
from evaluation.chart import Bar, Panel, chart
from evaluation.data_sets.clouds import devon_halves, milk_carton, small_gicp_pair
from evaluation.scenes.terrain import window_pair

RADII_VOXELS = (8.0, 12.0, 15.0)
TERRAIN_SEEDS = range(5)
POINTS, NEAR_VOXELS, KEYPOINT_VOXELS = 8000, 1.5, 1.5


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return recall and cost of the descriptors, and the errors of poses on measured clouds."""
    simulated = ((f"seed {seed}", *window_pair(seed, 0.7)) for seed in TERRAIN_SEEDS)
    return {
        "simulated_terrain, 70 % overlap": evaluate_descriptors(simulated, progress),
        "small_gicp_pair": evaluate_descriptors(iter([("pair", *small_gicp_pair(data))]), progress),
        "devon_island_halves": evaluate_descriptors(iter([("halves", *devon_halves(data))]), progress),
        "measured_scenes": evaluate_measured(data, progress),
    }


def evaluate_descriptors(
    pairs: Iterator[tuple[str, FloatArray, FloatArray, FloatArray]], progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return recall over all pairs and CPU time per keypoint, for each radius and descriptor."""
    totals: dict[str, list[float]] = {}
    for name, source, target, T in pairs:
        progress(f"shot_localisation: descriptors, {name}")
        voxel_m = max(voxel_for(source, POINTS), voxel_for(target, POINTS))
        clouds = [voxel_means(points, voxel_m) for points in (source, target)]
        normals = [
            _node("normals_estimation").process(NormalsEstimationInputs(points=p)).normals for p in clouds
        ]
        scale_m = np.array(KEYPOINT_VOXELS * voxel_m)
        keypoints = [_keypoints(p, scale_m) for p in clouds]
        true_positions = se3.transform_points(T, keypoints[0])
        is_trial = nearest(kd_tree(keypoints[1]), true_positions)[0] <= NEAR_VOXELS * voxel_m
        for radius in RADII_VOXELS:
            for kind, config in (("Shot", {"signed_normals": False}), ("Fpfh", {})):
                describe = _node("features_description_3d", kind, config)
                started = time.process_time()
                outputs = [
                    describe.process(
                        FeaturesDescription3DInputs(
                            points=p, normals=n, keypoints=k, radius_m=radius * voxel_m
                        )
                    ).descriptors
                    for p, n, k in zip(clouds, normals, keypoints, strict=True)
                ]
                cpu_s = time.process_time() - started
                matches = (
                    _node("features_matching_3d")
                    .process(FeaturesMatching3DInputs(source=outputs[0], target=outputs[1]))
                    .matches
                )
                errors_m = np.linalg.norm(true_positions[matches[:, 0]] - keypoints[1][matches[:, 1]], axis=1)
                correct = np.count_nonzero(errors_m <= NEAR_VOXELS * voxel_m)
                total = totals.setdefault(f"radius {radius:g} voxels, {kind}", [0, 0, 0, 0.0, 0])
                for i, value in enumerate(
                    (correct, np.count_nonzero(is_trial), len(matches), cpu_s, sum(map(len, keypoints)))
                ):
                    total[i] += value
    return {
        name: {
            "recall": interval(int(correct), int(trials)),
            "matches": int(matches),
            "us_per_keypoint": round(1e6 * cpu_s / count, 1),
        }
        for name, (correct, trials, matches, cpu_s, count) in totals.items()
    }


def evaluate_measured(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors of the milk carton relative to PCL's tutorial, and of Devon Island's halves."""
    figures: dict[str, Any] = {}
    model, scene, T_pcl = milk_carton(data)
    centre = model.mean(axis=0, keepdims=True)
    for implementation in ("Uniform", "Iss"):
        progress(f"shot_localisation: carton, {implementation}")
        output, cpu_s = localise(scene, model, implementation)
        entry: dict[str, Any] = {"status": str(output.quality.status), "cpu_s": round(cpu_s, 2)}
        if output.value is not None:
            T = output.value.transform.matrix
            difference_m = se3.transform_points(T, centre) - se3.transform_points(T_pcl, centre)
            entry |= {
                "centre_from_pcl_m": round(float(np.linalg.norm(difference_m)), 4),
                "rotation_from_pcl_deg": round(pose_errors(T, T_pcl)[1], 2),
                "rms_m": round(float(output.quality.metrics["rms_m"]), 5),
            }
        figures[f"carton, {implementation}"] = entry
    road, copy, T_copy_road = devon_halves(data)
    for name, (model, scene, T_true) in {
        "Devon Island, road in copy": (road, copy, T_copy_road),
        "Devon Island, copy in road": (copy, road, se3.inverse(T_copy_road)),
    }.items():
        progress(f"shot_localisation: {name}")
        output, cpu_s = localise(scene, model)
        entry = {"status": str(output.quality.status), "cpu_s": round(cpu_s, 2)}
        if output.value is not None:
            error_m, error_deg = pose_errors(output.value.transform.matrix, T_true)
            entry |= {"error_m": round(error_m, 5), "error_deg": round(error_deg, 5)}
        figures[name] = entry
    return figures


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: recall of SHOT and FPFH by radius, one panel for each set of clouds, as SVG."""
    panels = []
    for name in list(figures)[:3]:
        methods: dict[str, list[Bar | None]] = {
            kind: [
                _percent(figures[name][f"radius {radius:g} voxels, {kind}"]["recall"])
                for radius in RADII_VOXELS
            ]
            for kind in ("Shot", "Fpfh")
        }
        top = 1.1 * max(bar[2] for bars in methods.values() for bar in bars if bar)
        label = f"{name.replace('_', ' ')}: recall, %"
        panels.append(Panel(label, [f"radius {radius:g} voxels" for radius in RADII_VOXELS], methods, top))
    return chart(panels)


def table(figures: dict[str, Any]) -> str:
    """Return the tables: recall and cost by radius, and the errors on measured clouds."""
    lines = [
        "| clouds | radius, voxels | SHOT | FPFH | SHOT µs per keypoint | FPFH µs per keypoint |",
        "|---" * 6 + "|",
    ]
    for name in list(figures)[:3]:
        for radius in RADII_VOXELS:
            rows = [figures[name][f"radius {radius:g} voxels, {kind}"] for kind in ("Shot", "Fpfh")]
            recalls = " | ".join(f"{row['recall']['rate']:.1%}: {rate_text(row['recall'])}" for row in rows)
            costs = " | ".join(f"{row['us_per_keypoint']:.0f}" for row in rows)
            lines.append(f"| {name.replace('_', ' ')} | {radius:g} | {recalls} | {costs} |")
    lines += ["", "| model in scene, no guess | answer | CPU s |", "|---|---|---|"]
    for name, entry in figures["measured_scenes"].items():
        answer = entry["status"]
        if "centre_from_pcl_m" in entry:
            centre_mm, rotation_deg = 1e3 * entry["centre_from_pcl_m"], entry["rotation_from_pcl_deg"]
            answer += f", {centre_mm:.1f} mm and {rotation_deg:.1f}° from PCL's pose"
            answer += f", residuals {1e3 * entry['rms_m']:.2f} mm"
        if "error_m" in entry:
            answer += f", {1e3 * entry['error_m']:.1f} mm, {entry['error_deg']:.3f}°"
        lines.append(f"| {name} | {answer} | {entry['cpu_s']:.1f} |")
    return "\n".join(lines)


def _percent(rate: dict[str, float]) -> Bar:
    return 100.0 * rate["rate"], 100.0 * rate["low"], 100.0 * rate["high"]


def localise(scene: FloatArray, model: FloatArray, implementation: str | None = None) -> tuple[Output, float]:
    """Return the output of the DFPC with default configuration and no guess, and CPU seconds."""
    dfpc = Registry.default().make_dfpc("shot_localisation")
    dfpc.configure(implementation=implementation)
    samples = [
        Sample(port, 0, 0, Pointcloud.from_points(points, frame=port, stamp_ns=0))
        for port, points in (("model", model), ("scene", scene))
    ]
    started = time.process_time()
    (output,) = [output for sample in samples for output in dfpc.step(sample)]
    return output, time.process_time() - started


def _keypoints(points: FloatArray, scale_m: float) -> FloatArray:
    inputs = FeaturesExtraction3DInputs(points=points, radius_m=scale_m)
    return np.asarray(_node("features_extraction_3d", "Uniform").process(inputs).keypoints)


def _node(name: str, implementation: str | None = None, config: dict[str, Any] | None = None) -> Any:
    dfn = Registry.default().make_dfn(name, implementation)
    dfn.configure(config or {})
    return dfn
