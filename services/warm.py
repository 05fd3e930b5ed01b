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
from cdff_common.raster.warm import warm_rasters


def warm_algorithms() -> tuple[int, dict[str, str]]:
    """Configure every DFN and DFPC, which compiles their kernels.

    Returns
    -------
    tuple of int and dict of str to str
        How many implementations were configured, and why which were not: a library of one that is missing on this
        machine keeps no other from being compiled.
    """
    from cdff_common.errors import CdffError
    from cdff_common.interfaces.registry import Registry

    registry = Registry.default()
    count, left = 0, dict(registry.failures)

    def dfn(name: str, implementation: str) -> None:
        registry.make_dfn(name, implementation).configure()

    def dfpc(name: str, implementation: str) -> None:
        registry.make_dfpc(name).configure(implementation=implementation)

    todo = [(dfn, name, i) for name, found in registry.dfns.items() for i in found.description.implementations]
    todo += [(dfpc, name, i.name) for name, found in registry.dfpcs.items() for i in found.description.implementations]
    for configure, name, implementation in todo:
        try:
            configure(name, implementation)
            count += 1
        except (CdffError, ImportError, OSError) as error:
            left[f"{name}.{implementation}"] = f"{type(error).__name__}: {error}"
    return count, left


def main(argv: list[str] | None = None) -> int:
    """Warm, and say how long it took."""
    parser = argparse.ArgumentParser(prog="warm", description=__doc__)
    parser.add_argument("--algorithms", action="store_true", help="also every DFN and DFPC")
    args = parser.parse_args(argv)
    started = time.monotonic()
    warm_wire()
    warm_rasters()
    count, left = warm_algorithms() if args.algorithms else (0, {})
    for name, reason in left.items():
        sys.stderr.write(f"not warmed: {name}: {' '.join(reason.split())}\n")
    sys.stdout.write(f"warmed the wire and {count} implementations in {time.monotonic() - started:.1f} s\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
