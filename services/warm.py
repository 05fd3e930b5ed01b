# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compile numba kernels ahead of their first use, for installations and container images.

    python -m services.warm [--profile NAME | --algorithms] [--jobs N]

Without options only codecs and rasters are compiled, which the DPM and the orchestrator use; ``--profile``
adds the DFPCs of one mission profile, ``--algorithms`` every DFN and DFPC.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import NamedTuple

from cdff_common.cli import run_safely


class Task(NamedTuple):
    """An algorithm or group of kernels to compile.

    ``kind`` is ``codecs``, ``rasters``, ``dfpc`` or ``dfn``, with an empty ``owner``, or ``profile``, with
    the path of the profile as ``owner``, the DFPC as ``name`` and the robot as ``variant``.
    """

    kind: str
    name: str = ""
    variant: str = ""
    owner: str = ""


def profile_tasks(name: str) -> list[Task]:
    """Return the DFPCs that a mission profile runs, configured by the profile, each once."""
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.resources import resolve

    path = resolve("profiles", name)
    robots: dict[tuple[str, str | None], str] = {}
    for robot in load_profile(path).robots:
        for entry in robot.dfpcs:
            robots.setdefault((entry.name, entry.implementation), robot.id)
    return [Task("profile", dfpc, robot, str(path)) for (dfpc, _), robot in robots.items()]


def algorithm_tasks() -> list[Task]:
    """Return every implementation of every DFPC and DFN of this installation."""
    from cdff_common.interfaces.registry import Registry

    registry = Registry.default()
    tasks = [
        Task("dfpc", name, implementation.name)
        for name, package in registry.dfpcs.items()
        for implementation in package.description.implementations
    ]
    for name, reason in registry.failures.items():
        sys.stderr.write(f"not compiled: {name}: {' '.join(reason.split())}\n")
    return tasks + [
        Task("dfn", name, implementation)
        for name, package in registry.dfns.items()
        for implementation in package.description.implementations
    ]


def compile_task(task: Task) -> str:
    """Execute a task; return the reason of a failure, or an empty string.

    A missing library affects only the tasks that need it.
    """
    from cdff_common.errors import CdffError

    try:
        _compile(task)
    except (CdffError, ImportError, OSError) as error:
        return f"{type(error).__name__}: {' '.join(str(error).split())}"
    return ""


def _compile(task: Task) -> None:
    if task.kind == "codecs":
        from cdff_common.codecs.warm import warm_wire

        warm_wire()
        return
    if task.kind == "rasters":
        from cdff_common.raster.warm import warm_rasters

        warm_rasters()
        return
    from cdff_common.interfaces.registry import Registry

    registry = Registry.default()
    if task.kind == "dfn":
        registry.make_dfn(task.name, task.variant).configure()
    elif task.kind == "dfpc":
        registry.make_dfpc(task.name).configure(implementation=task.variant)
    else:
        from cdff_common.interfaces.profile import load_profile

        robot = load_profile(task.owner).robot(task.variant)
        entry = robot.dfpc(task.name)
        dfpc = registry.make_dfpc(task.name)
        dfpc.configure(entry.parameters, robot.context(entry), entry.implementation)


def main(argv: list[str] | None = None) -> int:
    """Compile in parallel processes and print the duration."""
    parser = argparse.ArgumentParser(prog="warm", description=__doc__)
    scope = parser.add_mutually_exclusive_group()
    scope.add_argument(
        "--profile", action="append", default=[], help="DFPCs of this mission profile; repeatable"
    )
    scope.add_argument("--algorithms", action="store_true", help="every DFN and DFPC")
    parser.add_argument("--jobs", type=int, default=min(os.cpu_count() or 1, 4), help="processes")
    args = parser.parse_args(argv)
    started = time.monotonic()
    tasks = [Task("codecs"), Task("rasters")]
    tasks += algorithm_tasks() if args.algorithms else [t for p in args.profile for t in profile_tasks(p)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=args.jobs, mp_context=context) as pool:
        pending = {pool.submit(compile_task, task): task for task in tasks}
        for completed, future in enumerate(as_completed(pending), start=1):
            if reason := future.result():
                task = pending[future]
                sys.stderr.write(f"not compiled: {task.name} {task.variant}: {reason}\n")
            if sys.stderr.isatty():
                sys.stderr.write(f"\rcompiled {completed} of {len(tasks)}")
    if sys.stderr.isatty():
        sys.stderr.write("\n")
    sys.stdout.write(f"compiled {len(tasks)} subjects in {time.monotonic() - started:.1f} s\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_safely(main))
