# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Localisation by RootSIFT, exhaustive matching and PoseLib, in a process of CDFF_PEER_PYTHON."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray

Images = NDArray[np.uint8]

_SCRIPT = """
import sys, time, cv2, numpy as np, poselib
z = np.load(sys.argv[1])
cv2.setNumThreads(1)
K = z["K"]
def features(image):
    detector = cv2.SIFT.create(1500, contrastThreshold=0.01)
    keypoints, d = detector.detectAndCompute(image, None)
    pixels = np.array([k.pt for k in keypoints])
    return pixels, np.sqrt(d / np.maximum(d.sum(axis=1, keepdims=True), 1e-9)).astype(np.float32)
def match(a, b, ratio):
    s = a @ b.T
    best = s.argmax(axis=1)
    rows = np.arange(len(a))
    first = s[rows, best]
    mutual = s.argmax(axis=0)[best] == rows
    s[rows, best] = -1.0
    d1, d2 = np.sqrt(np.maximum(2 - 2 * first, 0)), np.sqrt(np.maximum(2 - 2 * s.max(axis=1), 1e-9))
    keep = mutual & (d1 < ratio * d2)
    return rows[keep], best[keep]
frames = []
for i in range(len(z["poses"])):
    pixels, d = features(z["images"][i])
    if "right" in z:
        other, e = features(z["right"][i])
        a, b = match(d, e, 0.9)
        on_row = np.abs(pixels[a, 1] - other[b, 1]) < 1.5
        a, b = a[on_row], b[on_row]
        disparity = pixels[a, 0] - other[b, 0]
        a, depth = a[disparity > 1.0], K[0, 0] * float(z["baseline"]) / disparity[disparity > 1.0]
    else:
        rows, columns = np.clip(np.rint(pixels[:, ::-1]).astype(int), 0, np.array(z["depth"][i].shape) - 1).T
        depth = z["depth"][i][rows, columns].astype(float)
        a = np.flatnonzero(depth > 0.1)
        depth = depth[a]
    rays = np.column_stack([pixels[a], np.ones(len(a))]) @ np.linalg.inv(K).T
    T = z["poses"][i]
    frames.append((d[a], (rays * depth[:, None]) @ T[:3, :3].T + T[:3, 3]))
poses, cpu = [], []
for image in z["queries"]:
    started = time.process_time()
    pixels, d = features(image)
    found = [(pixels[a], X[b]) for e, X in frames for a, b in [match(d, e, 0.85)]]
    x, X = np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])
    camera = {"model": "PINHOLE", "width": image.shape[1], "height": image.shape[0],
              "params": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]}
    pose, info = poselib.estimate_absolute_pose(x, X, camera, {"max_reproj_error": 4.0, "seed": 0}, {})
    cpu.append(time.process_time() - started)
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = pose.R, pose.t
    poses.append(np.linalg.inv(M))
np.savez(sys.argv[2], poses=poses, cpu=cpu)
"""


def localise(
    python: str,
    images: Images,
    poses: FloatArray,
    camera_matrix: FloatArray,
    queries: Images,
    *,
    right: tuple[Images, float] | None = None,
    depth_m: NDArray[np.float32] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return ``T_map_camera`` (n, 4, 4) and CPU seconds of each query image.

    Parameters
    ----------
    images, queries : ndarray of uint8, shapes (m, rows, columns) and (n, rows, columns)
        Images of the map and queries, without lens distortion.
    poses : ndarray, shape (m, 4, 4)
        ``T_map_camera`` of the images.
    right : tuple of ndarray and float, optional
        Right images of rectified pairs, and their baseline, metres.
    depth_m : ndarray, shape (m, rows, columns), optional
        Depth of each pixel, metres, 0 without.
    """
    arrays = {"images": images, "poses": poses, "K": camera_matrix, "queries": queries}
    if right is not None:
        arrays |= {"right": right[0], "baseline": np.array(right[1])}
    if depth_m is not None:
        arrays["depth"] = depth_m
    with tempfile.TemporaryDirectory() as folder:
        data, result = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(data, **arrays)
        subprocess.run([python, "-c", _SCRIPT, str(data), str(result)], check=True)
        with np.load(result) as result_arrays:
            return result_arrays["poses"], result_arrays["cpu"]
