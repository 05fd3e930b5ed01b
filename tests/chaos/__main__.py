# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run a mission under random disturbances, and check its promises.

    python -m tests.chaos --minutes 10 [--seed 0] [--out FILE] [--keep FOLDER]

The summary is JSON: disturbances, products, requests, alarms, memory and violations. The exit code is 1 if
there is a violation, each of which is also a line on standard error.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from tests.chaos.campaign import run


def main() -> int:
    """Run the campaign and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="tests.chaos", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=None, help="file for the summary")
    parser.add_argument("--keep", type=Path, default=None, help="new folder for data and logs")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="cdff-chaos-") as scratch:
        summary = run(args.keep or Path(scratch), args.minutes, args.seed)
    text = json.dumps(summary, indent=1) + "\n"
    sys.stdout.write(text)
    if args.out is not None:
        args.out.write_text(text, encoding="utf-8")
    for violation in summary["violations"]:
        sys.stderr.write(f"violation: {violation}\n")
    return 1 if summary["violations"] else 0


if __name__ == "__main__":
    raise SystemExit(main())
