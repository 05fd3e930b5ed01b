# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Execution of evaluations on Dask workers as units of a campaign, which can be resumed."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cdff_common.errors import RefusedError
from cdff_dev.campaign.runner import TABLE, run_campaign, write_table
from cdff_dev.campaign.units import Unit

#: Largest duration of an evaluation, seconds.
_TIMEOUT_S = 24 * 3600.0


def figures(
    root: Path, names: list[str], data: Path, args: argparse.Namespace, origin: Mapping[str, Any]
) -> dict[str, Any]:
    """Run evaluations on workers that can access ``root``, and return the results by name.

    Successful results in ``build/evaluation`` of the same commit and options are reused; with uncommitted
    changes all evaluations are run.

    Raises
    ------
    RefusedError
        If an evaluation failed, after all others have ended.
    """
    options = [
        text for name in ("seed", "count") if getattr(args, name) is not None for text in _option(args, name)
    ]
    code = {name: origin[name] for name in ("commit", "lock_sha256", "python")}
    state = json.dumps([code, options, str(data.resolve())], sort_keys=True)
    folder = root / "build" / "evaluation" / hashlib.sha256(state.encode()).hexdigest()[:16]
    if origin["tree_differs"]:
        folder = folder.with_name(f"{folder.name}-{uuid.uuid4().hex}")
    units = [
        Unit(
            name.replace(":", "."),
            (
                "-m",
                "evaluation",
                name,
                "--data",
                str(data.resolve()),
                "--figures",
                "{out}/summary.json",
                *options,
            ),
            {"evaluation": name},
        )
        for name in names
    ]

    def report(result: Mapping[str, Any]) -> None:
        sys.stdout.write(f"{result['name']}: exit code {result['exit_code']}, {result['wall_s']:.0f} s\n")

    results = run_campaign(units, folder, dask=args.dask, timeout_s=_TIMEOUT_S, on_result=report)
    write_table(results, folder / TABLE)
    failed = [result for result in results if result["exit_code"]]
    if failed:
        raise RefusedError(
            f"evaluation {failed[0]['labels']['evaluation']} failed: {failed[0]['error'][-500:]}"
        )
    return {result["labels"]["evaluation"]: result["summary"] for result in results}


def _option(args: argparse.Namespace, name: str) -> tuple[str, str]:
    return f"--{name}", str(getattr(args, name))
