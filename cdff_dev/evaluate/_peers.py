# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KISS-Matcher on given clouds, in an environment of its own: CDFF_PEER_PYTHON names its interpreter."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cdff_common.geometry.se3 import FloatArray

PEER_VOXEL_M = 0.3
_CODE = """
import sys, time, numpy as np, kiss_matcher
z = np.load(sys.argv[1])
matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=float(sys.argv[3])))
T, valid, cpu = [], [], []
for i in range(int(z["count"])):
    s, t = (z[f"{n}{i}"].astype(np.float32) for n in ("source", "target"))
    started = time.process_time()
    found = matcher.estimate(list(s), list(t))
    cpu.append(time.process_time() - started)
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = found.rotation, found.translation
    T.append(M)
    valid.append(bool(found.valid))
    matcher.clear()
np.savez(sys.argv[2], T=T, valid=valid, cpu=cpu)
"""


def peer_python() -> str | None:
    """Interpreter of an environment with kiss-matcher and numpy, or None: the peer's rows are then left out."""
    return os.environ.get("CDFF_PEER_PYTHON") or None


def kiss_matcher(python: str, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray | None, float]]:
    """T_target_source or None (not ``valid``), and CPU seconds, of each pair; its defaults, voxels of 0.3 m."""
    with tempfile.TemporaryDirectory() as folder:
        given, taken = Path(folder) / "pairs.npz", Path(folder) / "found.npz"
        arrays = {f"source{i}": pair[0] for i, pair in enumerate(pairs)}
        arrays |= {f"target{i}": pair[1] for i, pair in enumerate(pairs)}
        np.savez(given, count=np.array(len(pairs)), **arrays)
        command = [python, "-c", _CODE, str(given), str(taken), str(PEER_VOXEL_M)]
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        z = np.load(taken)
        return [(T if ok else None, float(cpu)) for T, ok, cpu in zip(z["T"], z["valid"], z["cpu"], strict=True)]
