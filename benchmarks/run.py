# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run the benchmarks of this folder one after the other, and write ``build/benchmarks/NAME.json`` for each.

    python benchmarks/run.py [NAME ...]

``gateway_dds`` needs Cyclone DDS, which ``make peers`` installs in ``build/cyclonedds``.

Results depend on the machine and its load: compare ratios, and state the machine.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "build" / "benchmarks"


def main() -> int:
    """Run the named benchmarks, or all; return 1 if one failed."""
    benchmarks = {p.stem: p for p in sorted(HERE.glob("[!_]*.py")) if p != Path(__file__).resolve()}
    names = sys.argv[1:] or list(benchmarks)
    unknown = [n for n in names if n not in benchmarks]
    if unknown:
        print(f"no benchmark {unknown[0]!r}; known are {', '.join(benchmarks)}", file=sys.stderr)
        return 2
    OUT.mkdir(parents=True, exist_ok=True)
    packages = [os.environ.get("PYTHONPATH", ""), str(HERE.parent / "build" / "cyclonedds")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, packages))}
    failed = []
    for name in names:
        print(f"==== {name}", flush=True)
        command = [sys.executable, str(benchmarks[name]), "--out", str(OUT / f"{name}.json")]
        if subprocess.run(command, cwd=HERE.parent, env=environment, check=False).returncode:
            failed.append(name)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
