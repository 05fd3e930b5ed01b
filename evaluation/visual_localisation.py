# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``visual_localisation`` on real images: EuRoC V1_01 pairs and 7-Scenes, with RootSIFT and PoseLib as peer.

Figures of a set: median error of position (mm) and rotation (degrees), ratios of queries within limits,
refused queries, false fixes (more than 0.25 m or 5 degrees off and not refused), normalised squared error per
degree of freedom (1 expected; the covariance of the true pose of the query is added), CPU seconds per query.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import read_camera
from cdff_common.formats.image import read_image
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import DistanceImage, Frame, VisualMap
from cdff_core.imaging.grey import grey_image
from cdff_core.visual_map.keyframe_points import registered_depth
from cdff_dev.logs import open_log
from cdff_dev.map_building.build import MapOptions, build_map
from evaluation.data_sets import euroc
from evaluation.peers.environments import peer_python
from evaluation.peers.poselib_localisation import localise

PARTS = ("euroc", "kitchen", "other_scene")
PEER = "RootSIFT + PoseLib"
KITCHEN = "seven_scenes_redkitchen"
#: Accuracy of the true poses. EuRoC: the README of the set states 0.15 degrees. 7-Scenes: a few cm of drift.
EUROC_SIGMAS = (0.004, 0.15)
KITCHEN_SIGMAS = (0.02, 1.0)
#: Position of the depth camera in the frame of the colour camera of a Kinect, metres.
KITCHEN_OFFSET_M = (-0.025, 0.0, 0.0)
#: Last frame of the map, and first frame of the queries.
KITCHEN_LAST, KITCHEN_FIRST = 460, 463
LIMITS = {
    "euroc": ((0.05, 1.0), (0.05, 0.5), (0.05, 0.25)),
    "kitchen": ((0.05, 5.0), (0.1, 5.0), (0.25, 5.0)),
}
_FALSE_M, _FALSE_DEG = 0.25, 5.0
#: Frames of the kitchen between two that are searched in the map of EuRoC.
_OTHER_STRIDE = 3


def evaluate(
    data: Path, progress: Callable[[str], None], parts: tuple[str, ...] = PARTS
) -> dict[str, dict[str, Any]]:
    """Return the figures of each part."""
    methods = {"euroc": _euroc, "kitchen": _kitchen, "other_scene": _other_scene}
    figures = {}
    for part in parts:
        progress(f"visual localisation: {part}")
        figures[part] = methods[part](data)
    return figures


def table(figures: dict[str, dict[str, Any]]) -> str:
    """Return the tables of the page."""
    lines = []
    for part, name in (("euroc", "EuRoC V1_01"), ("kitchen", "7-Scenes kitchen")):
        limits = [f"{100 * m:g} cm, {deg:g}°" for m, deg in LIMITS[part]]
        lines += [
            f"| {name} | queries | median | {' | '.join(limits)} "
            "| refused | false fixes | NEES / 6 (1 expected) | CPU s |",
            "|---" * (7 + len(limits)) + "|",
        ]
        for method, row in figures.get(part, {}).items():
            within = " | ".join(f"{100 * row['within'][limit]:.0f} %" for limit in limits)
            lines.append(
                f"| {method} | {row['queries']} | {row['median_mm']} mm, {row['median_deg']}° | {within} "
                f"| {row['refused']} | {row['false_fixes']} | {row.get('nees_per_freedom', '–')} "
                f"| {row['cpu_s']} |"
            )
        lines.append("")
    lines += [
        f"{name}: ratio of the estimated focal length to the stated one {row['focal_ratio'][1]} "
        f"(10 % to 90 %: {row['focal_ratio'][0]} to {row['focal_ratio'][2]}), reported for "
        f"{row['focal_reported']} of {row['queries']} queries.\n"
        for part, name in (("euroc", "EuRoC"), ("kitchen", "7-Scenes"))
        if "focal_ratio" in (row := figures.get(part, {}).get("cdff", {}))
    ]
    lines += ["| another scene | images | refused |", "|---|---|---|"]
    other = figures.get("other_scene", {})
    lines += [f"| {name} | {row['images']} | {row['refused']} |" for name, row in other.items()]
    return "\n".join(lines)


def _euroc(data: Path) -> dict[str, Any]:
    folder = data / euroc.FOLDER
    queries, truth = _euroc_queries(folder)
    dfpc = _localiser(_euroc_map(folder))
    focal: list[tuple[float, bool]] = []
    answers = _run(dfpc, queries, focal)
    result = {"cdff": _figures("euroc", answers, truth, EUROC_SIGMAS) | _focal_figures(focal)}
    if python := peer_python("poselib"):
        views = euroc.stereo_views(folder)
        views_by_stamp = {v.pair.stamp_ns: v for v in views}
        stamps = {int(p.name.split("_")[0]) // 1000 * 1000 for p in (folder / "query").glob("*_0.jpg")}
        mapped = [v for s, v in views_by_stamp.items() if s not in stamps]
        query_views = [v for s, v in views_by_stamp.items() if s in stamps]
        poses, cpu = localise(
            python,
            np.array([v.pair.left.image for v in mapped]),
            np.array([v.T_world_left for v in mapped]),
            np.array(mapped[0].pair.camera_matrix),
            np.array([v.pair.left.image for v in query_views]),
            right=(np.array([v.pair.right.image for v in mapped]), float(mapped[0].pair.baseline)),
        )
        answers = [(T, None, s) for T, s in zip(poses, cpu, strict=True)]
        result[PEER] = _figures("euroc", answers, [v.T_world_left for v in query_views], EUROC_SIGMAS)
    return result


def _kitchen(data: Path) -> dict[str, Any]:
    frames = kitchen_frames(data)
    query_frames = [f for n, f in frames.items() if n >= KITCHEN_FIRST]
    truth = [f.T_world_colour for f in query_frames]
    dfpc = _localiser(_kitchen_map(data))
    focal: list[tuple[float, bool]] = []
    answers = _run(dfpc, [f.colour for f in query_frames], focal)
    result = {"cdff": _figures("kitchen", answers, truth, KITCHEN_SIGMAS) | _focal_figures(focal)}
    if python := peer_python("poselib"):
        mapped = [f for n, f in frames.items() if n <= KITCHEN_LAST]
        offset = se3.transform(np.eye(3), KITCHEN_OFFSET_M)
        poses, cpu = localise(
            python,
            np.array([grey_image(f.colour) for f in mapped]),
            np.array([f.T_world_colour for f in mapped]),
            np.array(mapped[0].colour.camera_matrix),
            np.array([grey_image(f.colour) for f in query_frames]),
            depth_m=np.array([registered_depth(f.colour, f.depth, offset) for f in mapped]),
        )
        answers = [(T, None, s) for T, s in zip(poses, cpu, strict=True)]
        result[PEER] = _figures("kitchen", answers, truth, KITCHEN_SIGMAS)
    return result


def _other_scene(data: Path) -> dict[str, Any]:
    """Return how many images of each set the map of the other one refuses."""
    kitchen = [f.colour for f in kitchen_frames(data).values()][::_OTHER_STRIDE]
    pairs, _ = _euroc_queries(data / euroc.FOLDER)
    fixes = {}
    for name, value, images in (
        ("kitchen images in the map of EuRoC", _euroc_map(data / euroc.FOLDER), kitchen),
        ("EuRoC images in the map of the kitchen", _kitchen_map(data), pairs),
    ):
        answers = _run(_localiser(value), images)
        fixes[name] = {"images": len(images), "refused": sum(T is None for T, _, _ in answers)}
    return fixes


@cache
def _euroc_map(folder: Path) -> VisualMap:
    log = open_log(folder / "map")
    try:
        return build_map(log, MapOptions(*EUROC_SIGMAS))
    finally:
        log.close()


@cache
def _kitchen_map(data: Path) -> VisualMap:
    log = open_log(data / KITCHEN)
    options = MapOptions(*KITCHEN_SIGMAS, depth_offset_m=KITCHEN_OFFSET_M, last_s=(KITCHEN_LAST - 220) * 0.1)
    try:
        return build_map(log, options)
    finally:
        log.close()


def _euroc_queries(folder: Path) -> tuple[list[Frame], list[FloatArray]]:
    """Return the raw left images with their camera, and the true poses ``T_world_left``."""
    camera = read_camera(folder / "calibration.yaml")
    T_imu_left = np.array(euroc.cameras(folder)[0]["T_imu_cam"], np.float64)
    T_imu_left = se3.transform(se3.normalise_rotation(T_imu_left[:3, :3]), T_imu_left[:3, 3])
    poses = euroc.true_poses(folder)
    frames, truth = [], []
    for path in sorted((folder / "query").glob("*_0.jpg")):
        frame = Frame.from_image(
            read_image(path),
            stamp_ns=0,
            camera_matrix=camera.matrix,
            dist_coeffs=camera.distortion,
            sensor="euroc/navcam",
        )
        frames.append(frame)
        truth.append(poses[int(path.name.split("_")[0])] @ T_imu_left)
    return frames, truth


class KitchenFrame(NamedTuple):
    """Colour image, depth image and true pose of the colour camera."""

    colour: Frame
    depth: DistanceImage
    T_world_colour: FloatArray


@cache
def kitchen_frames(data: Path) -> dict[int, KitchenFrame]:
    """Return the frames by their number."""
    log = open_log(data / KITCHEN)
    streams = {info.type_name: name for name, info in log.streams.items()}
    values = {
        kind: {s.stamp_ns: s.value for s in log.samples([streams[kind]])}
        for kind in ("Frame", "DistanceImage", "TransformWithCovariance")
    }
    log.close()
    T_depth_colour = se3.inverse(se3.transform(np.eye(3), KITCHEN_OFFSET_M))
    return {
        stamp // 100_000_000: KitchenFrame(
            frame,
            values["DistanceImage"][stamp],
            values["TransformWithCovariance"][stamp].transform.matrix @ T_depth_colour,
        )
        for stamp, frame in values["Frame"].items()
    }


def _localiser(value: VisualMap) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_localisation")
    dfpc.configure({})
    list(dfpc.step(Sample("map", 0, 0, value)))
    return dfpc


def _run(
    dfpc: Dfpc, images: list[Frame], focal: list[tuple[float, bool]] | None = None
) -> list[tuple[FloatArray | None, FloatArray | None, float]]:
    """Return pose and covariance, None if refused, and CPU seconds of each image.

    The ratio of the estimated focal length to the stated one, and whether it is reported, are added to
    ``focal``.
    """
    answers = []
    for image in images:
        started = time.process_time()
        (output,) = dfpc.step(Sample("image", 0, 0, image))
        cpu_s = time.process_time() - started
        T = None if output.value is None else output.value.transform
        if focal is not None and "focal_length_ratio" in output.quality.metrics:
            is_reported = any(r.startswith("focal_length") for r in output.quality.reasons)
            focal.append((output.quality.metrics["focal_length_ratio"], is_reported))
        answers.append((None, None, cpu_s) if T is None else (T.matrix, T.covariance, cpu_s))
    return answers


def _focal_figures(focal: list[tuple[float, bool]]) -> dict[str, Any]:
    """Return the distribution of the ratio of the focal lengths, and the number of reported differences."""
    low, median, high = np.percentile([ratio for ratio, _ in focal], [10, 50, 90])
    return {
        "focal_ratio": [round(float(v), 4) for v in (low, median, high)],
        "focal_reported": sum(is_reported for _, is_reported in focal),
    }


def _figures(
    part: str,
    answers: list[tuple[FloatArray | None, FloatArray | None, float]],
    truth: list[FloatArray],
    truth_sigmas: tuple[float, float],
) -> dict[str, Any]:
    errors, squares = [], []
    noise = np.diag(np.repeat([truth_sigmas[0], np.radians(truth_sigmas[1])], 3) ** 2.0)
    for (T, covariance, _), T_true in zip(answers, truth, strict=True):
        if T is None:
            errors.append((np.inf, np.inf))
            continue
        error = pose_error(T_true, T)
        errors.append((float(np.linalg.norm(error[:3])), float(np.degrees(np.linalg.norm(error[3:])))))
        if covariance is not None:
            squares.append(float(error @ np.linalg.solve(covariance + noise, error)))
    E = np.array(errors)
    refused = int(np.isinf(E[:, 0]).sum())
    wrong = np.isfinite(E[:, 0]) & ((E[:, 0] > _FALSE_M) | (E[:, 1] > _FALSE_DEG))
    figures: dict[str, Any] = {
        "queries": len(E),
        "median_mm": round(float(np.median(E[:, 0])) * 1e3, 1),
        "median_deg": round(float(np.median(E[:, 1])), 3),
        "within": {
            f"{100 * m:g} cm, {deg:g}°": round(float(np.mean((E[:, 0] <= m) & (E[:, 1] <= deg))), 3)
            for m, deg in LIMITS[part]
        },
        "refused": refused,
        "false_fixes": int(wrong.sum()),
        "cpu_s": round(float(np.mean([s for _, _, s in answers])), 3),
    }
    if squares:
        figures["nees_per_freedom"] = round(float(np.mean(squares)) / 6.0, 2)
    return figures
