# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The codecs without numba, as in an installation of the extra ``client``."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.types import Pointcloud

PROGRAM = """
import sys
for name in ("numba", "scipy", "sqlalchemy"):
    sys.modules[name] = None
from cdff_common.client import Client
from cdff_common.codecs import decode, encode
codec = sys.argv[1]
value = decode("Pointcloud", sys.stdin.buffer.read(), codec)
sys.stdout.buffer.write(encode(value, codec))
"""


@pytest.mark.parametrize("codec", ["uper", "msgpack"])
def test_a_cloud_is_decoded_and_encoded_without_numba(codec: str) -> None:
    points = np.random.default_rng(1).normal(size=(5000, 3))
    data = encode(Pointcloud.from_points(points, frame="site", stamp_ns=1000), codec)
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM, codec], input=data, capture_output=True, check=False, timeout=60
    )
    assert result.returncode == 0, result.stderr.decode()
    assert result.stdout == data
    assert np.array_equal(decode("Pointcloud", result.stdout, codec).points_m, points)
