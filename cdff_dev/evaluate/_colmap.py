# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""COLMAP on the same inputs, in an environment of its own (CDFF_PEER_PYTHON, with pycolmap and numpy installed)."""

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
        camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 1.2 * max(rows, columns), columns, rows)
        xy = np.array([[k.x, k.y] for k in keypoints], float).reshape(-1, 2)
        views.append((keypoints, descriptors, xy, camera))
    (ka, da, a, ca), (kb, db, b, cb) = views
    matches = matcher.match(ka, da, kb, db)
    found = pycolmap.estimate_two_view_geometry(ca, a, cb, b, matches).inlier_matches if len(matches) else []
    # COLMAP's origin is the corner of the top left pixel, ours its centre.
    out[f"matches{i}"] = np.hstack([a[found[:, 0]], b[found[:, 1]]]) - 0.5 if len(found) else np.zeros((0, 4))
    out[f"cpu{i}"] = time.process_time() - started
np.savez(sys.argv[2], **out)
"""


def run(python: str, code: str, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Run a script of the peer on arrays and return its arrays."""
    with tempfile.TemporaryDirectory() as folder:
        given, taken = Path(folder) / "given.npz", Path(folder) / "taken.npz"
        np.savez(given, **inputs)  # type: ignore[arg-type]  # its keywords are arrays
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run(
            [python, "-c", code, str(given), str(taken)], check=True, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        with np.load(taken) as z:
            return dict(z)


def matches(
    python: str, pairs: Sequence[tuple[NDArray[np.uint8], NDArray[np.uint8]]]
) -> list[tuple[NDArray[np.float64], float]]:
    """Verified matches ``x0 y0 x1 y1 (n, 4)`` and CPU seconds of each pair of images: SIFT with COLMAP's defaults."""
    arrays = {f"left{i}": np.ascontiguousarray(left) for i, (left, _) in enumerate(pairs)}
    arrays |= {f"right{i}": np.ascontiguousarray(right) for i, (_, right) in enumerate(pairs)}
    found = run(python, _MATCH, {"count": np.array(len(pairs)), **arrays})
    return [(found[f"matches{i}"], float(found[f"cpu{i}"])) for i in range(len(pairs))]
