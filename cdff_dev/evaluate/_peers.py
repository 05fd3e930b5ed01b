# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KISS-Matcher and KISS-ICP on given clouds, in an environment of their own: CDFF_PEER_PYTHON names its interpreter."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cdff_common.geometry.se3 import FloatArray

PEER_VOXEL_M = 0.3
_PAIRS = """
import os, sys, time, numpy as np
z = np.load(sys.argv[1])
T, valid, cpu = [], [], []
for i in range(int(z["count"])):
    s, t = z[f"source{i}"], z[f"target{i}"]
    started = time.process_time()
    M, ok = register(s, t)
    cpu.append(time.process_time() - started)
    T.append(M)
    valid.append(ok)
np.savez(sys.argv[2], T=T, valid=valid, cpu=cpu)
"""
_MATCHER = """
import numpy as np, kiss_matcher
matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=VOXEL))
def register(s, t):
    found = matcher.estimate(list(s.astype(np.float32)), list(t.astype(np.float32)))
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = found.rotation, found.translation
    ok = bool(found.valid)
    matcher.clear()
    return M, ok
"""
_ICP = """
import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
def register(s, t):
    config = KISSConfig()
    config.data.deskew, config.mapping.voxel_size = False, config.data.max_range / 100.0
    config.registration.max_num_threads = 1
    odometry = KissICP(config)
    for cloud in (t, s):
        odometry.register_frame(cloud, np.zeros(len(cloud)))
    return np.array(odometry.last_pose), True
"""


def peer_python() -> str | None:
    """Interpreter of an environment with kiss-matcher and numpy, or None: the peer's rows are then left out."""
    return os.environ.get("CDFF_PEER_PYTHON") or None


def kiss_matcher(python: str, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray | None, float]]:
    """T_target_source or None (not ``valid``), and CPU seconds, of each pair; its defaults, voxels of 0.3 m."""
    return _registered(python, _MATCHER.replace("VOXEL", str(PEER_VOXEL_M)), pairs)


def kiss_icp(python: str, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray | None, float]]:
    """T_target_source and CPU seconds of each pair as two frames of its odometry; defaults, without deskewing."""
    return _registered(python, _ICP, pairs)


def _registered(
    python: str, code: str, pairs: Sequence[tuple[FloatArray, FloatArray]]
) -> list[tuple[FloatArray | None, float]]:
    with tempfile.TemporaryDirectory() as folder:
        given, taken = Path(folder) / "pairs.npz", Path(folder) / "found.npz"
        arrays = {f"source{i}": pair[0] for i, pair in enumerate(pairs)}
        arrays |= {f"target{i}": pair[1] for i, pair in enumerate(pairs)}
        np.savez(given, count=np.array(len(pairs)), **arrays)
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        command = [python, "-c", code + _PAIRS, str(given), str(taken)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        z = np.load(taken)
        return [(T if ok else None, float(cpu)) for T, ok, cpu in zip(z["T"], z["valid"], z["cpu"], strict=True)]
