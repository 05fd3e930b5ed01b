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

from cdff_common.codecs.warm import warm_wire


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
