# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which processes a profile needs on one machine, in which order: pure data, no process started."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cdff_common.interfaces.profile import Profile

GROUND_SERVICES = ("router", "dpm", "orchestrator", "icu")


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process.

    Attributes
    ----------
    name : str
    argv : tuple of str
    environment : mapping of str to str
        What is set on top of the supervisor's own.
    tokens : tuple of (scope, service)
        Liveliness tokens that say it is ready.
    """

    name: str
    argv: tuple[str, ...]
    environment: Mapping[str, str]
    tokens: tuple[tuple[str, str], ...]


def plan(profile: Profile, profile_path: Path, *, connect: str, http: str, data_dir: Path) -> list[ProcessSpec]:
    """Return the processes of a profile in the order in which they are started.

    Parameters
    ----------
    profile, profile_path
        The mission and the file it was read from.
    connect : str
        Endpoint the router listens on and everybody else connects to.
    http : str
        ``host:port`` of the DPM's HTTP server.
    data_dir : Path
        Where the DPM and the orchestrator's journal keep their data.
    """
    environment = {
        "CDFF_CONNECT": connect,
        "CDFF_LISTEN": connect,
        "CDFF_PROFILE": str(profile_path.resolve()),
        "CDFF_DATA_DIR": str(data_dir.resolve()),
        "PYTHONUNBUFFERED": "1",
        **{
            v: str(profile.threads_per_process)
            for v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
        },
    }

    def spec(name: str, module: str, *arguments: str, tokens: tuple[tuple[str, str], ...]) -> ProcessSpec:
        return ProcessSpec(name, (sys.executable, "-m", module, *arguments), environment, tokens)

    specs = [
        spec("router", "services.router", tokens=(("ground", "router"),)),
        spec("dpm", "services.dpm", "--http", http, tokens=(("ground", "dpm"),)),
        spec("orchestrator", "services.orchestrator", tokens=(("ground", "orchestrator"),)),
        spec("icu", "services.icu", tokens=(("ground", "icu"),)),
    ]
    if profile.merging is not None:
        specs.append(spec("map_merging", "services.map_merging", tokens=(("ground", "map_merging"),)))
    for process, entries in profile.processes().items():
        tokens = tuple((robot, entry.name) for robot, entry in entries)
        specs.append(spec(process, "services.dfpc_host", "--process", process, tokens=tokens))
    return specs
