# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Track ViSP's castle in its grey and depth images with visual_target_tracking and default parameters.

``starts``: the guess is the true pose of the first image, and true poses with seeded errors. ``disturbed``:
frames 8 to 11 are black, or their right half is. ``depth``: the same with the depth images, whose camera is
next to the grey one. ``file_camera``: the principal point is that of the camera file. Errors are those of all
used images; errors of published predictions are separate. ``principal_point``: differences between the
measured depth and that of the mesh at the true poses, for two principal points. ``comet``: photographs of
comet 67P, with and without the direction to the Sun (``evaluation.scenes.comet_images``). ``spacecraft``:
single photographs of a satellite mock-up, each from wrong starts (``evaluation.scenes.spacecraft_images``).
``client``: the stereo pair of DLR's client (``evaluation.scenes.client_pair``).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.formats.meshes.read import read_mesh
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import DistanceImage, Frame, Mesh, Time, TransformWithCovariance
from evaluation.scenes.client_pair import client_figures, client_table
from evaluation.scenes.comet_images import comet_rows, comet_summary, comet_table
from evaluation.scenes.spacecraft_images import spacecraft_rows, spacecraft_summary, spacecraft_table

PARTS = ("starts", "disturbed", "depth", "file_camera", "principal_point", "comet", "spacecraft", "client")
FOLDER, COMET = "visp_castle", "rosetta_67p"
#: Camera of the files, px. Its origin is the corner of the first pixel, as ``principal_point`` shows; that of
#: CDFF is the centre of the first pixel.
FILE_CAMERA_MATRIX = np.array([[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]])
CAMERA_MATRIX = FILE_CAMERA_MATRIX - np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])
#: Unit of the depth images, position of their camera relative to the grey one, and largest difference that
#: counts (larger ones are at outlines), metres; step between the images that are compared.
DEPTH_UNIT_M, T_DEPTH_GREY_M, LARGEST_M, STEP = 3.0518e-5, np.array([-0.05, 0.0, 0.0]), 0.01, 4
INTERVAL_NS = 100_000_000
#: Errors of the guesses, standard deviation per axis, and their number.
GUESS_MM, GUESS_DEG, SEEDS = 3.0, 1.0, 5
DISTURBED = range(8, 12)
#: Runs with 67P, and number of guesses of the first.
COMET_SEEDS = 3
COMET_RUNS: dict[str, dict[str, Any]] = {
    "with the Sun, 3 guesses": {},
    "with the Sun, 4 photographs black": {"dark": range(20, 24)},
    "without the Sun": {"with_sun": False},
}
Change = Callable[[int, ByteArray], ByteArray]


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the results of each part."""
    poses, images = truth(data), grey_images(data)
    figures: dict[str, Any] = {}
    if "starts" in parts:
        progress("visual_target_tracking: starts")
        guesses = [poses[0], *(guess_near(poses[0], seed) for seed in range(SEEDS))]
        runs = [track(data, poses, images, guess) for guess in guesses]
        figures["starts"] = {"true first pose": summary(runs[:1])}
        figures["starts"][f"{SEEDS} guesses {GUESS_MM:g} mm, {GUESS_DEG:g}° off per axis"] = summary(runs[1:])
    if "disturbed" in parts:
        figures["disturbed"] = {}
        for name, change in DISTURBANCES.items():
            progress(f"visual_target_tracking: {name}")
            figures["disturbed"][name] = summary([track(data, poses, images, poses[0], change)])
    if "depth" in parts:
        progress("visual_target_tracking: depth")
        figures["depth"] = depth_figures(data, poses, images)
    if "file_camera" in parts:
        run = track(data, poses, images, poses[0], camera_matrix=FILE_CAMERA_MATRIX)
        figures["file_camera"] = {"true first pose": summary([run])}
    if "principal_point" in parts:
        figures["principal_point"] = {
            name: _rounded(1e3 * depth_difference_m(data, poses, matrix))
            for name, matrix in (("320, 240", FILE_CAMERA_MATRIX), ("319.5, 239.5", CAMERA_MATRIX))
        }
    if "comet" in parts:
        figures["comet"] = {}
        for name, options in COMET_RUNS.items():
            progress(f"visual_target_tracking: 67P, {name}")
            seeds = range(COMET_SEEDS if not options else 1)
            figures["comet"][name] = comet_summary(
                [comet_rows(data / COMET, seed, **options) for seed in seeds]
            )
    if "spacecraft" in parts:
        figures["spacecraft"] = {"defaults": spacecraft_summary(spacecraft_rows(data, progress))}
    if "client" in parts:
        progress("visual_target_tracking: client")
        figures["client"] = client_figures(data)
    return figures


def depth_figures(data: Path, poses: FloatArray, images: list[ByteArray]) -> dict[str, Any]:
    """Return the results with depth images: with and without the grey images, and with disturbances."""
    depths, figures = depth_images(data), {}
    runs: dict[str, tuple[list[ByteArray] | None, Change | None]] = {
        "grey and depth": (images, None),
        "depth alone": (None, None),
        "grey and depth, 4 frames black": (images, _black),
        "grey and depth, right half of 4 frames black": (images, _half),
    }
    for name, (greys, change) in runs.items():
        guesses = [poses[0], *(guess_near(poses[0], seed) for seed in range(SEEDS if change is None else 0))]
        figures[name] = summary(
            [track(data, poses, greys, guess, change, depths=depths) for guess in guesses]
        )
    return figures


def depth_images(data: Path) -> list[DistanceImage]:
    """Return the depth images."""
    import cv2

    values = []
    for k, file in enumerate(sorted((data / FOLDER / "depth").glob("*.png"))):
        raw = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), np.float64)
        values.append(
            DistanceImage(
                ref_time=Time.from_ns(k * INTERVAL_NS),
                width=raw.shape[1],
                height=raw.shape[0],
                scale_x=1.0 / CAMERA_MATRIX[0, 0],
                scale_y=1.0 / CAMERA_MATRIX[1, 1],
                center_x=-CAMERA_MATRIX[0, 2] / CAMERA_MATRIX[0, 0],
                center_y=-CAMERA_MATRIX[1, 2] / CAMERA_MATRIX[1, 1],
                data=DEPTH_UNIT_M * raw.ravel(),
            )
        )
    return values


def depth_difference_m(data: Path, poses: FloatArray, camera_matrix: FloatArray) -> float:
    """Return the mean absolute difference between the measured depth and that of the mesh, metres."""
    import cv2
    import open3d

    model = read_mesh(data / FOLDER / "models" / "chateau.wrl")
    scene = open3d.t.geometry.RaycastingScene()
    vertices, triangles = np.asarray(model.vertices, np.float32), np.asarray(model.triangles, np.uint32)
    scene.add_triangles(open3d.core.Tensor(vertices), open3d.core.Tensor(triangles))
    files = sorted((data / FOLDER / "depth").glob("*.png"))
    differences = []
    for T, file in list(zip(poses, files, strict=True))[::STEP]:
        depth_m = DEPTH_UNIT_M * np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), np.float64)
        v, u = np.mgrid[: depth_m.shape[0], : depth_m.shape[1]]
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1).astype(np.float64)
        R, t = T[:3, :3], T[:3, 3] + T_DEPTH_GREY_M
        directions = pixels @ np.linalg.inv(camera_matrix).T @ R
        origins = np.broadcast_to(-R.T @ t, directions.shape)
        rays = open3d.core.Tensor(np.concatenate([origins, directions], axis=-1).astype(np.float32))
        difference_m = (depth_m - scene.cast_rays(rays)["t_hit"].numpy())[depth_m > 0.0]
        differences.append(np.abs(difference_m[np.abs(difference_m) < LARGEST_M]))
    return float(np.mean(np.concatenate(differences)))


def truth(data: Path) -> FloatArray:
    """Return T_camera_model (n, 4, 4)."""
    table = np.loadtxt(data / FOLDER / "truth.csv", delimiter=",", skiprows=1)
    T = np.tile(np.eye(4), (len(table), 1, 1))
    T[:, :3] = table[:, 1:].reshape(-1, 3, 4)
    return T


def grey_images(data: Path) -> list[ByteArray]:
    """Return the grey images."""
    import cv2

    files = sorted((data / FOLDER / "gray").glob("*.png"))
    return [np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8) for file in files]


def guess_near(T: FloatArray, seed: int) -> FloatArray:
    """Return a pose with random errors."""
    rng = np.random.default_rng(seed)
    R = se3.exp_so3(rng.normal(0.0, np.radians(GUESS_DEG), 3)) @ T[:3, :3]
    return se3.transform(R, T[:3, 3] + rng.normal(0.0, 1e-3 * GUESS_MM, 3))


def _black(frame: int, image: ByteArray) -> ByteArray:
    return np.zeros_like(image) if frame in DISTURBED else image


def _half(frame: int, image: ByteArray) -> ByteArray:
    changed = image.copy()
    if frame in DISTURBED:
        changed[:, image.shape[1] // 2 :] = 0
    return changed


DISTURBANCES: dict[str, Change] = {"4 frames black": _black, "right half of 4 frames black": _half}


def track(
    data: Path,
    poses: FloatArray,
    images: list[ByteArray] | None,
    guess: FloatArray,
    change: Change | None = None,
    config: Mapping[str, Any] | None = None,
    camera_matrix: FloatArray = CAMERA_MATRIX,
    depths: list[DistanceImage] | None = None,
) -> list[dict[str, float]]:
    """Return the errors for each time; ``config`` is that of the DFPC."""
    model = read_mesh(data / FOLDER / "models" / "chateau.wrl")
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    offset_m = tuple(-T_DEPTH_GREY_M)
    dfpc.configure({**({} if depths is None else {"depth_offset_m": offset_m}), **(config or {})})
    mesh = Mesh.from_arrays(model.vertices, model.triangles, frame="castle/body", stamp_ns=0)
    start = TransformWithCovariance.from_transform(
        UncertainTransform(guess), parent="camera", child="castle/body", stamp_ns=0
    )
    list(dfpc.step(Sample("model", 0, 0, mesh)))
    list(dfpc.step(Sample("guess", 0, 0, start)))
    rows = []
    for k, T in enumerate(poses):
        samples = []
        if depths is not None:
            samples.append(Sample("depth", k * INTERVAL_NS, k, depths[k]))
        if images is not None:
            frame = Frame.from_image(
                images[k] if change is None else change(k, images[k]),
                sensor="camera",
                stamp_ns=k * INTERVAL_NS,
                camera_matrix=camera_matrix,
            )
            samples.append(Sample("image", k * INTERVAL_NS, k, frame))
        start_s = time.process_time()
        outputs = [output for sample in samples for output in dfpc.step(sample)]
        # A depth image without an image waits for one at first.
        pose, _ = outputs or dfpc.finish()
        cpu_s = time.process_time() - start_s
        estimate = pose.value.transform
        error = pose_error(T, estimate.matrix)
        rows.append(
            {
                "frame": float(k),
                "cpu_s": cpu_s,
                "mm": float(1e3 * np.linalg.norm(error[:3])),
                "deg": float(np.degrees(np.linalg.norm(error[3:]))),
                "nees": float(error @ np.linalg.solve(estimate.covariance, error)),
                "is_coasting": float("coasting" in pose.quality.reasons),
                "is_degraded": float(bool(pose.quality.reasons)),
            }
        )
    return rows


def summary(runs: list[list[dict[str, float]]]) -> dict[str, Any]:
    """Return the figures of runs."""
    rows = [row for run in runs for row in run]
    tracked_rows = [row for row in rows if not row["is_coasting"]]
    predictions = [row["mm"] for row in rows if row["is_coasting"]]
    return {
        "images": len(rows),
        "median_mm": _rounded(np.median([row["mm"] for row in tracked_rows])),
        "largest_mm": _rounded(max(row["mm"] for row in tracked_rows)),
        "median_deg": _rounded(np.median([row["deg"] for row in tracked_rows])),
        "largest_deg": _rounded(max(row["deg"] for row in tracked_rows)),
        "mean_nees": _rounded(np.mean([row["nees"] for row in tracked_rows])),
        "degraded": int(sum(row["is_degraded"] for row in rows)),
        "coasting": len(predictions),
        "largest_predicted_mm": _rounded(max(predictions, default=0.0)),
        "median_cpu_ms": _rounded(1e3 * np.median([row["cpu_s"] for row in rows if row["frame"] > 0])),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table of the page."""
    lines = [
        "| run | images | median | largest | mean NEES (6 expected) | DEGRADED | coasting | CPU ms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for part in ("starts", "disturbed", "depth", "file_camera"):
        for name, row in figures.get(part, {}).items():
            coasting = f"{row['coasting']}"
            coasting += f", up to {row['largest_predicted_mm']} mm" if row["coasting"] else ""
            lines.append(
                f"| {part}: {name} | {row['images']} | {row['median_mm']} mm, {row['median_deg']}° | "
                f"{row['largest_mm']} mm, {row['largest_deg']}° | {row['mean_nees']} | {row['degraded']} | "
                f"{coasting} | {row['median_cpu_ms']} |"
            )
    if "principal_point" in figures:
        lines += ["", "| principal point, px | mean difference of depth, mm |", "|---|---|"]
        lines += [f"| {name} | {value} |" for name, value in figures["principal_point"].items()]
    if "comet" in figures:
        lines += ["", *comet_table(figures["comet"])]
    if "spacecraft" in figures:
        lines += ["", *spacecraft_table(figures["spacecraft"])]
    if "client" in figures:
        lines += ["", *client_table(figures["client"])]
    return "\n".join(lines)


def _rounded(value: Any) -> float:
    return float(f"{float(value):.3g}")
