# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Track cube and dragon of ``visp_rbt_rgbd`` with model_tracking and default parameters.

The true poses are only known to 1 to 2.5 cm, but the motion between two frames is known from the board in the
colour images. The error of a frame is the difference between the motion of the estimate from the previous
frame and that of the board: the displacement of the origin of the object, and the angle. ``runs``: without a
guess, from the hand-made guess, with parts of the images and without their colours. ``disturbed``: frames 76
to 79 have no measurement or the half of the object is hidden by a screen. ``reference``: the same error of a motion that
OpenCV estimates for the whole scene from the colour images (P3P with RANSAC of tracked corners and their
depths), without any result of the compound: it shows how good the board is as a reference. ``m3t``: the two
frames of ``m3t_pair``, where a bottle hides a part of a triangle, and the answer of DLR's tracker M3T.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.camera import read_camera
from cdff_common.formats.meshes.read import read_mesh
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, Mesh, TransformWithCovariance
from evaluation.data_sets.rgbd_objects import INTERVAL_NS, Change, TrackedObjects, distance_image

PARTS = ("runs", "disturbed", "reference", "m3t")
FOLDER, M3T = "visp_rbt_rgbd", "m3t_pair"
OBJECTS = ("dragon", "cube")
DISTURBED = range(76, 80)
#: Distance of a simulated screen in front of the right half of the object from the camera, millimetres.
_SCREEN_MM = 250
#: Corners of the reference and their largest error, px; range of the depths, metres.
_CORNERS, _REPROJECTION_PX, _RANGE_M = 600, 2.0, (0.2, 1.5)


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the results of each part."""
    figures: dict[str, Any] = {}
    objects = TrackedObjects(data / FOLDER)
    if "runs" in parts:
        figures["runs"] = {}
        for name in OBJECTS:
            for text, options in RUNS.items():
                progress(f"model_tracking: {name}, {text}")
                figures["runs"][f"{name}, {text}"] = summary(track(objects, name, **options))
    if "disturbed" in parts:
        figures["disturbed"] = {}
        for name in OBJECTS:
            progress(f"model_tracking: {name}, disturbed")
            nothing = track(objects, name, depth_change=_nothing, image_change=_nothing)
            figures["disturbed"][f"{name}, 4 frames empty"] = summary(nothing)
            hidden = _screen(objects, name)
            rows = track(objects, name, depth_change=hidden, image_change=hidden)
            figures["disturbed"][f"{name}, right half hidden in 4 frames"] = summary(rows)
    if "reference" in parts:
        progress("model_tracking: reference")
        figures["reference"] = reference(objects)
    if "m3t" in parts:
        progress("model_tracking: m3t")
        figures["m3t"] = m3t(data / M3T)
    return figures


RUNS: dict[str, dict[str, Any]] = {
    "image and depth, no guess": {},
    "image and depth, guess": {"with_guess": True},
    "image and depth without colours, no guess": {"config": {"colour": False}},
    "depth alone, no guess": {"ports": ("depth",)},
    "image alone, guess": {"ports": ("image",), "with_guess": True},
    "image alone without colours, guess": {
        "ports": ("image",),
        "with_guess": True,
        "config": {"colour": False},
    },
}


def track(
    objects: TrackedObjects,
    name: str,
    *,
    with_guess: bool = False,
    ports: Sequence[str] = ("depth", "image"),
    config: Mapping[str, Any] | None = None,
    depth_change: Change | None = None,
    image_change: Change | None = None,
) -> list[dict[str, Any]]:
    """Return pose, quality and errors of each frame."""
    dfpc = Registry.default().make_dfpc("model_tracking")
    dfpc.configure(dict(config or {}))
    list(dfpc.step(objects.model(name)))
    if with_guess:
        list(dfpc.step(objects.guess(name)))
    output_by_frame: dict[int, dict[str, Any]] = {}
    for frame in objects.frames:
        samples = []
        if "depth" in ports:
            samples.append(objects.depth(frame, depth_change))
        if "image" in ports:
            samples.append(objects.image(frame, image_change))
        start_s = time.process_time()
        outputs = [output for sample in samples for output in dfpc.step(sample)]
        cpu_s = time.process_time() - start_s
        if frame == objects.frames[-1]:
            outputs += dfpc.finish()
        for output in outputs:
            if output.port == "pose":
                number = round(output.t1_ns / INTERVAL_NS)
                T = None if output.value is None else output.value.transform.matrix
                output_by_frame[number] = {"T": T, "reasons": output.quality.reasons, "cpu_s": cpu_s}
    return [_row(objects, output_by_frame, previous, frame) for previous, frame in pairwise(objects.frames)]


def _row(
    objects: TrackedObjects, output_by_frame: Mapping[int, Mapping[str, Any]], previous: int, frame: int
) -> dict[str, Any]:
    """Return the error of the motion from the previous frame; NaN without both poses."""
    before, now = (
        output_by_frame.get(k, {"T": None, "reasons": ("no_output",), "cpu_s": 0.0})
        for k in (previous, frame)
    )
    metres, deg = float("nan"), float("nan")
    if before["T"] is not None and now["T"] is not None:
        estimate = now["T"] @ se3.inverse(before["T"])
        metres, deg = _difference(estimate, _board_motion(objects, previous, frame), before["T"][:, 3])
    return {
        "frame": frame,
        "T": now["T"],
        "mm": 1e3 * metres,
        "deg": deg,
        "cpu_s": now["cpu_s"],
        "reasons": list(now["reasons"]),
        "is_coasting": "coasting" in now["reasons"] or "coasting" in before["reasons"],
    }


def _board_motion(objects: TrackedObjects, previous: int, frame: int) -> FloatArray:
    return np.asarray(objects.boards[frame] @ se3.inverse(objects.boards[previous]))


def _difference(motion: FloatArray, other: FloatArray, point: FloatArray) -> tuple[float, float]:
    """Return the distance, metres, of a point (4,) after two motions (4, 4), and their angle, degrees."""
    angle = se3.rotation_angle(motion[:3, :3].T @ other[:3, :3])
    return float(np.linalg.norm((motion @ point - other @ point)[:3])), float(np.degrees(angle))


def _nothing(frame: int, image: ByteArray) -> ByteArray:
    return np.zeros_like(image) if frame in DISTURBED else image


def _screen(objects: TrackedObjects, name: str) -> Change:
    """Return the change that puts a screen in front of the right half of the object."""
    poses = objects.by_board(name)

    def change(frame: int, image: ByteArray) -> ByteArray:
        if frame not in DISTURBED:
            return image
        x, _, z = poses[frame][:3, 3]
        column = round(objects.camera_matrix[0, 0] * x / z + objects.camera_matrix[0, 2])
        changed = image.copy()
        changed[:, column:] = _SCREEN_MM if image.dtype == np.uint16 else 90
        return changed

    return change


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures of one run."""
    measured_rows = [row for row in rows if not row["is_coasting"] and np.isfinite(row["mm"])]
    measured_rows = measured_rows or [{"frame": 0, "mm": float("nan"), "deg": float("nan")}]
    worst = max(measured_rows, key=lambda row: row["mm"], default={"frame": 0})
    return {
        "motions": len(rows),
        "used": sum(row["mm"] == row["mm"] for row in measured_rows),
        "median_mm": _rounded(np.median([row["mm"] for row in measured_rows])),
        "largest_mm": _rounded(max(row["mm"] for row in measured_rows)),
        "largest_in_frame": worst["frame"],
        "median_deg": _rounded(np.median([row["deg"] for row in measured_rows])),
        "largest_deg": _rounded(max(row["deg"] for row in measured_rows)),
        "ok": sum(not row["reasons"] for row in rows),
        "failed": sum(row["T"] is None for row in rows),
        "median_cpu_ms": _rounded(1e3 * np.median([row["cpu_s"] for row in rows])),
        "frames": {
            str(row["frame"]): [_rounded(row["mm"]), _rounded(row["deg"]), row["reasons"]] for row in rows
        },
    }


def reference(objects: TrackedObjects) -> dict[str, Any]:
    """Return the difference between the motion of the board and that of the scene, for each frame."""
    import cv2

    point = np.array([0.0, 0.0, 0.5, 1.0])
    result = {}
    for previous, frame in pairwise(objects.frames):
        first, second = (
            cv2.cvtColor(np.asarray(objects.image(k).value.image), cv2.COLOR_BGR2GRAY)
            for k in (previous, frame)
        )
        corners = cv2.goodFeaturesToTrack(first, _CORNERS, 0.01, 6)[:, 0]
        tracked_corners, flow_status, _ = cv2.calcOpticalFlowPyrLK(
            first, second, corners, corners.copy(), winSize=(21, 21), maxLevel=4
        )
        back, _, _ = cv2.calcOpticalFlowPyrLK(
            second, first, tracked_corners, tracked_corners.copy(), winSize=(21, 21), maxLevel=4
        )
        depth = objects.depth(previous).value
        row, column = corners[:, ::-1].astype(int).T
        z = depth.data.reshape(depth.height, depth.width)[row, column]
        is_used = (flow_status[:, 0] > 0) & (np.linalg.norm(back - corners, axis=1) < 0.5)
        is_used &= (z > _RANGE_M[0]) & (z < _RANGE_M[1])
        K = objects.camera_matrix
        rays = np.column_stack([corners, np.ones(len(corners))]) @ np.linalg.inv(K).T
        points = (rays * z[:, None])[is_used]
        _, rotation, position, inliers = cv2.solvePnPRansac(
            points, tracked_corners[is_used].astype(np.float64), K, None, reprojectionError=_REPROJECTION_PX
        )
        motion = se3.transform(cv2.Rodrigues(rotation)[0], position[:, 0])
        m, deg = _difference(motion, _board_motion(objects, previous, frame), point)
        result[str(frame)] = [_rounded(1e3 * m), _rounded(deg), len(inliers)]
    errors = np.array([entry[:2] for entry in result.values()])
    return {
        "median_mm": _rounded(np.median(errors[:, 0])),
        "largest_mm": _rounded(errors[:, 0].max()),
        "median_deg": _rounded(np.median(errors[:, 1])),
        "largest_deg": _rounded(errors[:, 1].max()),
        "frames": result,
    }


def m3t(folder: Path) -> dict[str, Any]:
    """Return the differences from M3T's answer after two frames: millimetres, degrees, and reasons."""
    import cv2

    def matrix(file: str, name: str) -> FloatArray:
        storage = cv2.FileStorage(str(folder / file), cv2.FILE_STORAGE_READ)
        return np.asarray(storage.getNode(name).mat())

    color, depth = ("_sequence/color_camera.yaml", "_sequence/depth_camera.yaml")
    T_start = matrix("_body/triangle_static_detector.yaml", "link2world_pose")
    T_body_mesh, T_camera_depth = (
        matrix("_body/triangle.yaml", "geometry2body_pose"),
        matrix(depth, "camera2world_pose"),
    )
    lines = (folder / "expected_after_two_frames.txt").read_text().splitlines()[2:6]
    T_m3t = np.array([[float(word) for word in line.split(",") if word.strip()] for line in lines])
    mesh = read_mesh(folder / "_body" / "triangle.obj")
    vertices = se3.transform_points(T_body_mesh, np.asarray(mesh.vertices, np.float64))
    model = Mesh.from_arrays(vertices, mesh.triangles, frame="triangle/body", stamp_ns=0)
    guess = TransformWithCovariance.from_transform(
        UncertainTransform(T_start), parent="camera", child="triangle/body", stamp_ns=0
    )
    K, K_depth = (read_camera(folder / file).matrix for file in (color, depth))
    offset = {
        "depth_offset_m": tuple(T_camera_depth[:3, 3].tolist()),
        "depth_rotation_rad": tuple(se3.log_so3(se3.normalise_rotation(T_camera_depth[:3, :3])).tolist()),
    }
    result = {}
    for name, ports in (("image and depth", ("depth", "image")), ("image alone", ("image",))):
        dfpc = Registry.default().make_dfpc("model_tracking")
        dfpc.configure(offset)
        samples = [Sample("model", 0, 0, model), Sample("guess", 0, 0, guess)]
        for k, number in enumerate((200, 201)):
            raw, pixels = (
                np.asarray(cv2.imread(str(folder / "_sequence" / f"{kind}_camera_image_{number}.png"), -1))
                for kind in ("depth", "color")
            )
            stamp_ns = k * INTERVAL_NS
            frame = Frame.from_image(pixels, sensor="camera", stamp_ns=stamp_ns, mode="BGR", camera_matrix=K)
            values = {"depth": distance_image(raw, K_depth, k), "image": frame}
            samples += [Sample(port, stamp_ns, k, values[port], frame="camera") for port in ports]
        outputs = [output for sample in samples for output in dfpc.step(sample)]
        last = [output for output in outputs if output.port == "pose"][-1]
        T = last.value.transform.matrix
        metres, deg = _difference(T, T_m3t, np.array([0.0, 0.0, 0.0, 1.0]))
        sigma_mm = 1e3 * float(np.sqrt(last.value.transform.covariance[2, 2]))
        result[name] = [_rounded(1e3 * metres), _rounded(deg), list(last.quality.reasons), _rounded(sigma_mm)]
    metres, deg = _difference(T_start, T_m3t, np.array([0.0, 0.0, 0.0, 1.0]))
    return result | {"start": [_rounded(1e3 * metres), _rounded(deg), [], None]}


def table(figures: dict[str, Any]) -> str:
    """Return the table of the page."""
    lines = [
        "| run | motions used | median | largest (frame) | OK, FAILED | CPU ms |",
        "|---|---|---|---|---|---|",
    ]
    for part in ("runs", "disturbed"):
        for name, row in figures.get(part, {}).items():
            errors = "– | –"  # of no motion
            if row["median_mm"] is not None:
                errors = (
                    f"{row['median_mm']} mm, {row['median_deg']}° | "
                    f"{row['largest_mm']} mm ({row['largest_in_frame']}), {row['largest_deg']}°"
                )
            lines.append(
                f"| {name} | {row['used']} of {row['motions']} | {errors} | "
                f"{row['ok']}, {row['failed']} | {row['median_cpu_ms']} |"
            )
    if "reference" in figures:
        row = figures["reference"]
        lines.append(
            f"| whole scene, OpenCV | {len(row['frames'])} | {row['median_mm']} mm, {row['median_deg']}° | "
            f"{row['largest_mm']} mm, {row['largest_deg']}° | | |"
        )
    if "m3t" in figures:
        lines += ["", "| m3t_pair | difference from M3T | reasons | standard deviation of the range |"]
        lines += ["|---|---|---|---|"]
        lines += [
            f"| {name} | {mm} mm, {deg}° | {', '.join(reasons)} | {'' if sigma is None else f'{sigma} mm'} |"
            for name, (mm, deg, reasons, sigma) in figures["m3t"].items()
        ]
    return "\n".join(lines)


def _rounded(value: Any) -> float | None:
    return float(f"{float(value):.3g}") if np.isfinite(value) else None
