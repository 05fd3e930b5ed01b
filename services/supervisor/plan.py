# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Processes of a profile on one machine in start order, as plain data."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cdff_common.bus.identity import VARIABLE, Identity
from cdff_common.bus.keys import GROUND
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import Profile, Robot


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """Specification of a process.

    Attributes
    ----------
    name : str
    argv : tuple of str
    environment : mapping of str to str
        Variables added to the environment of the supervisor.
    tokens : tuple of (scope, service)
        Liveliness tokens of the ready process.
    """

    name: str
    argv: tuple[str, ...]
    environment: Mapping[str, str]
    tokens: tuple[tuple[str, str], ...]


def first_scope(profile: Profile, scopes: Collection[str]) -> str:
    """Return the scope of the router and supervisor of a machine: ground, else its first robot."""
    return next(scope for scope in (GROUND, *profile.robot_ids) if not scopes or scope in scopes)


def plan(
    profile: Profile,
    profile_path: Path,
    *,
    connect: str,
    http: str,
    data_dir: Path,
    scopes: Collection[str] = (),
    uplink: str | None = None,
    dpm_options: Sequence[str] = (),
    dpm_workers: int = 0,
    secrets: Path | None = None,
) -> list[ProcessSpec]:
    """Return the processes of a profile in start order.

    Parameters
    ----------
    profile, profile_path
        The mission and its file.
    connect : str
        Endpoint of the router.
    http : str
        ``host:port`` of the DPM's HTTP server.
    data_dir : Path
        Data folder of DPM, orchestrator and DFPCs.
    scopes : collection of str
        Scopes whose processes run: robots, and ``ground`` for the shared services; empty for all. Each has a
        router.
    uplink : str, optional
        Endpoint of a remote router to which the local one links.
    dpm_options : sequence of str
        Further options of the DPM.
    dpm_workers : int
        Further processes that answer on the HTTP address, if the store is on a server.
    secrets : Path, optional
        Folder of ``cdff keys``: the shared services have the identity ``ground``, DFPCs that of their robot,
        and the router that of its scope.

    Raises
    ------
    ConfigurationError
        If the profile has no such robot, or an identity or the settings of a gateway are missing.
    """
    all_scopes = (GROUND, *profile.robot_ids)
    for scope in scopes:
        if scope not in all_scopes:
            raise ConfigurationError(f"scope {scope!r}: profile {profile.name} has {', '.join(all_scopes)}")
    selected_scopes = scopes or all_scopes
    host = first_scope(profile, scopes)
    environment = {
        # no certificate is valid for the address of all interfaces
        "CDFF_CONNECT": connect.replace("/0.0.0.0:", "/127.0.0.1:"),
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
        process_environment = environment
        if secrets is not None:  # all tokens of a process have one scope
            process_environment = environment | {VARIABLE: str(Identity.read(secrets / tokens[0][0]).folder)}
        return ProcessSpec(name, (sys.executable, "-m", module, *arguments), process_environment, tokens)

    scope_of_ground = ("--scope", GROUND) if profile.orchestration == "robots" else ()
    uplink_arguments = ("--uplink", uplink) if uplink else ()
    specs = [
        spec("router", "services.router", "--scope", host, *uplink_arguments, tokens=((host, "router"),))
    ]
    if GROUND in selected_scopes:
        sharing = ("--share-port",) if dpm_workers else ()
        specs += [
            spec("dpm", "services.dpm", "--http", http, *sharing, *dpm_options, tokens=((GROUND, "dpm"),)),
            *(
                spec(name, "services.dpm", "--http", http, "--worker", str(n), tokens=((GROUND, name),))
                for n in range(1, dpm_workers + 1)
                for name in (f"dpm_{n}",)
            ),
            spec(
                "orchestrator", "services.orchestrator", *scope_of_ground, tokens=((GROUND, "orchestrator"),)
            ),
        ]
        if not scope_of_ground:
            specs.append(spec("icu", "services.icu", tokens=((GROUND, "icu"),)))
        if profile.merging is not None:
            specs.append(spec("map_merging", "services.map_merging", tokens=((GROUND, "map_merging"),)))
    for robot in profile.robots:
        if robot.id in selected_scopes:
            for service in ("orchestrator", "icu") if scope_of_ground else ():
                scope_arguments = ("--scope", robot.id)
                token = ((robot.id, service),)
                specs.append(
                    spec(f"{robot.id}_{service}", f"services.{service}", *scope_arguments, tokens=token)
                )
            for gateway, settings in _gateway_settings(robot, profile_path).items():
                options = ("--robot", robot.id, "--settings", str(settings))
                own_token = ((robot.id, gateway),)
                specs.append(spec(f"{robot.id}_{gateway}", f"services.{gateway}", *options, tokens=own_token))
    for process, entries in profile.processes().items():
        tokens = tuple((robot, entry.name) for robot, entry in entries if robot in selected_scopes)
        if tokens:
            specs.append(spec(process, "services.dfpc_host", "--process", process, tokens=tokens))
    return specs


def _gateway_settings(robot: Robot, profile_path: Path) -> dict[str, Path]:
    """Return the files of the settings of the gateways of a robot; raises ConfigurationError without one."""
    files: dict[str, Path] = {
        name: profile_path.resolve().parent / file for name, file in robot.gateways.items()
    }
    for name, file in files.items():
        if not file.is_file():
            raise ConfigurationError(
                f"{robot.id}.gateways.{name}: no file {file}; expected the settings of the gateway"
            )
    return files
