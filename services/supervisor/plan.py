# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which processes a profile needs on one machine, in which order: pure data, no process started."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from cdff_common.bus.keys import GROUND
from cdff_common.errors import ConfigurationError
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


def plan(
    profile: Profile, profile_path: Path, *, connect: str, http: str, data_dir: Path,
    scopes: Collection[str] = (), uplink: str | None = None,
) -> list[ProcessSpec]:  # fmt: skip
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
        Where the DPM and the orchestrator's journal keep their data, and the DFPCs theirs.
    scopes : collection of str
        Whose processes: robots, and ``ground`` for the services that they share; empty for all. Each has a router.
    uplink : str, optional
        Endpoint of the router elsewhere that the one here links to.

    Raises
    ------
    ConfigurationError
        If the profile has no such robot.
    """
    known = (GROUND, *profile.robot_ids)
    for scope in scopes:
        if scope not in known:
            raise ConfigurationError(f"scope {scope!r}: profile {profile.name} has {', '.join(known)}")
    chosen = scopes or known
    host = GROUND if GROUND in chosen else next(robot for robot in profile.robot_ids if robot in chosen)
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

    linked = ("--uplink", uplink) if uplink else ()
    specs = [spec("router", "services.router", "--scope", host, *linked, tokens=((host, "router"),))]
    if GROUND in chosen:
        specs += [
            spec("dpm", "services.dpm", "--http", http, tokens=((GROUND, "dpm"),)),
            spec("orchestrator", "services.orchestrator", tokens=((GROUND, "orchestrator"),)),
            spec("icu", "services.icu", tokens=((GROUND, "icu"),)),
        ]
        if profile.merging is not None:
            specs.append(spec("map_merging", "services.map_merging", tokens=((GROUND, "map_merging"),)))
    for process, entries in profile.processes().items():
        tokens = tuple((robot, entry.name) for robot, entry in entries if robot in chosen)
        if tokens:
            specs.append(spec(process, "services.dfpc_host", "--process", process, tokens=tokens))
    return specs
