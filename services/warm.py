# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compile what is compiled on first use, so that no service compiles while it serves: for images and installations.

    python -m services.warm [--algorithms]

Without ``--algorithms`` only the wire and the rasters are warmed: what the DPM and the orchestrator need.
"""

from __future__ import annotations

import argparse
import sys
import time


def warm_wire() -> None:
    """Encode, decode and measure one value of each bulk type in each encoding."""
    import numpy as np

    from cdff_common.codecs import decode, encode
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


def warm_algorithms() -> int:
    """Configure every DFN and DFPC, which compiles their kernels; return how many there were."""
    from cdff_common.interfaces.registry import Registry

    registry = Registry.default()
    for name, found in registry.dfns.items():
        for implementation in found.description.implementations:
            registry.make_dfn(name, implementation).configure()
    for name, found in registry.dfpcs.items():
        for variant in found.description.implementations:
            registry.make_dfpc(name).configure(implementation=variant.name)
    return len(registry.dfns) + len(registry.dfpcs)


def main(argv: list[str] | None = None) -> int:
    """Warm, and say how long it took."""
    parser = argparse.ArgumentParser(prog="warm", description=__doc__)
    parser.add_argument("--algorithms", action="store_true", help="also every DFN and DFPC")
    args = parser.parse_args(argv)
    started = time.monotonic()
    warm_wire()
    count = warm_algorithms() if args.algorithms else 0
    sys.stdout.write(f"warmed the wire and {count} DFNs and DFPCs in {time.monotonic() - started:.1f} s\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
