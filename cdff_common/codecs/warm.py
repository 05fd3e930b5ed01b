# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of the codecs: availability of numba, and loading before the first message arrives."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec


@cache
def has_numba() -> bool:
    """Return whether the compiled loops can be loaded; without them numbers are coded one by one.

    The extra ``client`` does not install numba.
    """
    return find_spec("numba") is not None


def warm_wire() -> None:
    """Encode and decode one small value of each bulk type, so that numba compiles or loads its loops."""
    import numpy as np

    from cdff_common.codecs import decode, encode
    from cdff_common.codecs.messagepack._kernels import skip_many
    from cdff_common.geometry import UncertainTransform
    from cdff_common.types import Frame, LidarScan, Pointcloud, TransformWithCovariance

    points = np.linspace(-1.0, 1.0, 600).reshape(-1, 3)
    transform = UncertainTransform(np.eye(4), np.eye(6))
    values = [
        Pointcloud.from_points(points, frame="site", stamp_ns=0),
        LidarScan.from_arrays(
            points.astype(np.float32), np.zeros(len(points), np.uint32), frame="site", t0_ns=0, t1_ns=1000
        ),
        Frame.from_image(np.zeros((16, 16), np.uint8), stamp_ns=0),
        TransformWithCovariance.from_transform(transform, parent="site", child="base", stamp_ns=0),
    ]
    for value in values:
        value.extent_m()
        for codec in ("uper", "msgpack"):
            decode(value.ASN1_NAME, encode(value, codec), codec)
    # The index of a log: a memory-mapped file is read-only.
    skip_many(np.frombuffer(bytes(4), dtype=np.uint8), 0, np.zeros(2, dtype=np.int64))
