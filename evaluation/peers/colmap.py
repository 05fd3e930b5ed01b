# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run COLMAP in a separate Python environment (CDFF_PEER_PYTHON, with pycolmap and numpy installed)."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MATCH = """
import sys, time, numpy as np, pycolmap
z = np.load(sys.argv[1])
extraction = pycolmap.FeatureExtractionOptions()
matching = pycolmap.FeatureMatchingOptions()
for o in (extraction, matching):
    o.num_threads, o.use_gpu = 1, False
extractor = pycolmap.FeatureExtractor.create(extraction, pycolmap.Device.cpu)
matcher = pycolmap.FeatureMatcher.create(matching, pycolmap.Device.cpu)
out = {}
for i in range(int(z["count"])):
    started = time.process_time()
    views = []
    for image in (z[f"left{i}"], z[f"right{i}"]):
        keypoints, descriptors = extractor.extract_from_uint8_array(image)
        rows, columns = image.shape
        focal_px = 1.2 * max(rows, columns)
        camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", focal_px, columns, rows)
        xy = np.array([[k.x, k.y] for k in keypoints], float).reshape(-1, 2)
        views.append((keypoints, descriptors, xy, camera))
    (ka, da, a, ca), (kb, db, b, cb) = views
    matches = matcher.match(ka, da, kb, db)
    inliers = np.zeros((0, 2), int)
    if len(matches):
        inliers = pycolmap.estimate_two_view_geometry(ca, a, cb, b, matches).inlier_matches
    # The origin of COLMAP is the corner of the top left pixel, that of CDFF its centre.
    both = np.hstack([a[inliers[:, 0]], b[inliers[:, 1]]]) if len(inliers) else np.zeros((0, 4))
    out[f"matches{i}"] = both - 0.5
    out[f"cpu{i}"] = time.process_time() - started
np.savez(sys.argv[2], **out)
"""


def run(python: str, code: str, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Run a script in the other environment; return the arrays that it computes from the input arrays."""
    with tempfile.TemporaryDirectory() as folder:
        input_path, output_path = Path(folder) / "inputs.npz", Path(folder) / "outputs.npz"
        np.savez(input_path, **inputs)  # type: ignore[arg-type]  # the keywords are names of arrays
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run(
            [python, "-c", code, str(input_path), str(output_path)],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        with np.load(output_path) as z:
            return dict(z)


def matches(
    python: str, pairs: Sequence[tuple[NDArray[np.uint8], NDArray[np.uint8]]]
) -> list[tuple[NDArray[np.float64], float]]:
    """Return the verified SIFT matches ``x0 y0 x1 y1 (n, 4)`` and CPU seconds of each image pair, with
    COLMAP's defaults.
    """
    arrays = {f"left{i}": np.ascontiguousarray(left) for i, (left, _) in enumerate(pairs)}
    arrays |= {f"right{i}": np.ascontiguousarray(right) for i, (_, right) in enumerate(pairs)}
    result = run(python, _MATCH, {"count": np.array(len(pairs)), **arrays})
    return [(result[f"matches{i}"], float(result[f"cpu{i}"])) for i in range(len(pairs))]
