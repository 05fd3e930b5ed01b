# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A unit of a campaign: one command, run in a separate process, with a folder for its results.

This module uses the standard library only: workers of Dask import it.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: File of the result in the folder of a unit.
RESULT = "unit.json"
_TAIL_CHARACTERS = 2000


@dataclass(frozen=True, slots=True)
class Unit:
    """A command of the Python interpreter.

    Attributes
    ----------
    name : str
        Name of the folder of the unit, unique in the campaign.
    arguments : tuple of str
        Arguments of ``python``; ``{out}`` is replaced by the folder of the unit.
    labels : dict
        Values that distinguish the unit, for the table of results.
    """

    name: str
    arguments: tuple[str, ...]
    labels: dict[str, Any]


def run_unit(unit: Unit, folder: str, timeout_s: float) -> dict[str, Any]:
    """Run a unit unless its result exists, and return the result.

    The command writes to a temporary folder, which is renamed when the command has ended. If two workers
    execute the same unit, for example because the connection to one was lost, the first result is kept.

    Returns
    -------
    dict
        ``name``, ``labels``, ``exit_code`` (-1 after ``timeout_s``), ``wall_s``, ``cpu_s``, ``error`` (end of
        the standard error of a failed command), ``summary`` (content of ``summary.json``) and ``pid``.
    """
    final = Path(folder) / unit.name
    if (final / RESULT).is_file():
        return dict(json.loads((final / RESULT).read_text(encoding="utf-8")))
    attempt = Path(folder) / f".{unit.name}.{uuid.uuid4().hex}"
    attempt.mkdir(parents=True)
    command = [sys.executable, *(a.replace("{out}", str(attempt)) for a in unit.arguments)]
    before_s, cpu = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    with (attempt / "stdout.txt").open("wb") as out, (attempt / "stderr.txt").open("wb") as err:
        try:
            exit_code = subprocess.run(
                command, stdout=out, stderr=err, stdin=subprocess.DEVNULL, timeout=timeout_s, check=False
            ).returncode
        except subprocess.TimeoutExpired:
            exit_code = -1
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    summary = attempt / "summary.json"
    error = (attempt / "stderr.txt").read_text(errors="replace")[-_TAIL_CHARACTERS:] if exit_code else ""
    result = {
        "name": unit.name,
        "labels": unit.labels,
        "exit_code": exit_code,
        "wall_s": time.monotonic() - before_s,
        "cpu_s": after.ru_utime + after.ru_stime - cpu.ru_utime - cpu.ru_stime,
        "error": error,
        "summary": json.loads(summary.read_text(encoding="utf-8")) if summary.is_file() else {},
        "pid": os.getpid(),
    }
    (attempt / RESULT).write_text(json.dumps(result), encoding="utf-8")
    try:
        attempt.rename(final)
    except OSError:  # another attempt was first
        shutil.rmtree(attempt)
        return dict(json.loads((final / RESULT).read_text(encoding="utf-8")))
    return result
