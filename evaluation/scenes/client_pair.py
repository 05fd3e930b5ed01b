# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""visual_target_tracking on the stereo pair of DLR's client, of which it gets the left image.

The start pose of DLR fits the left image within about 5 px. Start and result are compared with the right
image, which is not used: the fraction of the edge points of the mesh with an image edge close to them.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, Mesh, TransformWithCovariance
from cdff_core.dfns.model_edge_measurement.interface import ModelEdgeMeasurementInputs
from evaluation.data_sets.dlr_client import ClientCamera, cameras, mesh, start_pose

#: Errors of the starts around DLR's pose, standard deviation per axis; number of starts and of repetitions of
#: the image.
SIGMA_M, SIGMA_DEG, SEEDS, REPEATED = 0.01, 1.0, 5, 3
#: Distance of an edge that agrees, and range of the search, px.
NEAR_PX, RANGE_PX = 2.0, 8.0
_INTERVAL_NS = 100_000_000


def client_figures(data: Path) -> dict[str, Any]:
    """Return differences from DLR's pose, and the agreement of start and result with both images."""
    pair, body = cameras(data), mesh(data)
    T_start = start_pose(data, pair[0])
    rows = []
    for seed in range(SEEDS + 1):
        error = np.random.default_rng(seed).normal(size=6) if seed else np.zeros(6)
        T_error = se3.transform(se3.exp_so3(np.radians(SIGMA_DEG) * error[3:]), SIGMA_M * error[:3])
        guess = se3.transform(T_error[:3, :3] @ T_start[:3, :3], T_start[:3, 3] + T_error[:3, 3])
        T, reasons, cpu_s = _tracked(pair[0], body, guess)
        row: dict[str, Any] = {"seed": seed, "reasons": reasons, "cpu_s": round(cpu_s, 4)}
        if T is not None:
            difference = pose_error(T_start, T)
            row |= {
                "mm": round(1e3 * float(np.linalg.norm(difference[:3])), 2),
                "deg": round(float(np.degrees(np.linalg.norm(difference[3:]))), 3),
                "near": _near(pair, body, T),
            }
        rows.append(row)
    return {"start_near": _near(pair, body, T_start), "rows": rows}


def client_table(figures: Mapping[str, Any]) -> list[str]:
    """Return the lines of the table."""
    lines = [
        f"| DLR's client, start | difference from DLR's pose | edge points within {NEAR_PX:g} px, left, "
        "right image | flagged |",
        "|---|---|---|---|",
        "| DLR's pose itself, not tracked | 0 mm, 0° | " + _percent(figures["start_near"]) + " | |",
    ]
    for row in figures["rows"]:
        name = (
            f"{SIGMA_M * 1e3:g} mm and {SIGMA_DEG:g}° per axis, seed {row['seed']}"
            if row["seed"]
            else "DLR's"
        )
        found = f"{row['mm']} mm, {row['deg']}° | {_percent(row['near'])}" if "mm" in row else "no pose | "
        lines.append(f"| {name} | {found} | {', '.join(row['reasons'])} |")
    return lines


def _percent(near: list[float]) -> str:
    return ", ".join(f"{100.0 * ratio:.0f} %" for ratio in near)


def _tracked(
    camera: ClientCamera, body: tuple[FloatArray, Any], T_guess: FloatArray
) -> tuple[FloatArray | None, list[str], float]:
    """Return the pose in the last of several equal images, its reasons, and the CPU time of an image."""
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure()
    model = Mesh.from_arrays(*body, frame="client/body", stamp_ns=0)
    list(dfpc.step(Sample("model", 0, 0, model, id="model")))
    covariance = np.diag([SIGMA_M**2] * 3 + [np.radians(SIGMA_DEG) ** 2] * 3)
    guess = TransformWithCovariance.from_transform(
        UncertainTransform(T_guess, covariance), parent="camera", child="client/body", stamp_ns=0
    )
    list(dfpc.step(Sample("guess", 0, 0, guess)))
    pixels, K = _undistorted(camera)
    cpu_s = []
    for k in range(1, REPEATED + 1):
        stamp_ns = k * _INTERVAL_NS
        frame = Frame.from_image(pixels, mode="GRAY", sensor="camera", stamp_ns=stamp_ns, camera_matrix=K)
        start_s = time.process_time()
        pose, _ = dfpc.step(Sample("image", stamp_ns, k, frame, id=f"image{k}"))
        cpu_s.append(time.process_time() - start_s)
    T = None if pose.value is None else pose.value.transform.matrix
    return T, list(pose.quality.reasons), float(np.median(cpu_s))


def _near(
    pair: tuple[ClientCamera, ClientCamera], body: tuple[FloatArray, Any], T_left_body: FloatArray
) -> list[float]:
    """Return the fraction of the edge points with an edge within ``NEAR_PX``, of the left and right image."""
    dfn = Registry.default().make_dfn("model_edge_measurement")
    dfn.configure({"hypotheses": 20})
    ratios = []
    for camera in pair:
        image, K = _undistorted(camera)
        outputs = dfn.process(
            ModelEdgeMeasurementInputs(
                image=image.astype(np.float32),
                camera_matrix=K,
                pose=se3.inverse(camera.T_world_camera) @ pair[0].T_world_camera @ T_left_body,
                vertices=body[0],
                triangles=body[1],
                range_px=RANGE_PX,
            )
        )
        nearest = np.nan_to_num(np.abs(outputs.offsets), nan=np.inf).min(axis=1)
        ratios.append(round(float(np.mean(nearest < NEAR_PX)), 3))
    return ratios


def _undistorted(camera: ClientCamera) -> tuple[Any, FloatArray]:
    """Return the image without distortion, and its camera matrix without skew."""
    K = camera.matrix.copy()
    K[0, 1] = 0.0
    return cv2.undistort(camera.image, camera.matrix, camera.distortion, None, K), K
