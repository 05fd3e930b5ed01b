# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check that no other system uses the addresses, the data directory or the scopes, before the start."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.bus.keys import GROUND
from cdff_common.clock import monotonic_s
from cdff_common.errors import ConflictError, UnavailableError
from cdff_common.process import lock_file

if TYPE_CHECKING:
    from cdff_common.bus import Bus

_TIMEOUT_S = 1.0
#: Time in which the tokens of an ended system disappear, seconds.
_ENDED_S = 6.0
_ALL_INTERFACES = {"0.0.0.0": "127.0.0.1", "[::]": "::1"}


def check_vacant(endpoint: str, http: str | None, data_dir: Path) -> None:
    """Raise UnavailableError if another process uses an address or the data directory.

    Parameters
    ----------
    endpoint : str
        Endpoint of the router, as ``tcp/127.0.0.1:7447``.
    http : str or None
        ``host:port`` of the HTTP server and with it the store in ``data_dir``; None if no DPM is started.
    """
    protocol, _, address = endpoint.partition("/")
    if protocol in ("tcp", "tls") and _is_served(address):
        raise UnavailableError(
            f"router {endpoint}: another process listens there, such as a running `cdff up`; end it, or "
            "choose another endpoint with --connect tcp/127.0.0.1:PORT"
        )
    if http is None:
        return
    if _is_served(http):
        raise UnavailableError(
            f"HTTP {http}: another process listens there; end it, or choose another address with --http"
        )
    if (data_dir / "store.lock").exists():
        os.close(
            lock_file(data_dir / "store.lock", str(os.getpid()), lambda holder: _in_use(data_dir, holder))
        )


def check_joins(uplink: str, tokens: Collection[str], profiles: Mapping[str, Mapping[str, Any]]) -> None:
    """Check that no service of these scopes runs at the remote router, and that its ground accepts the robots.

    A router that is not reachable is not an error: the local router links to it as soon as it is reachable.

    Parameters
    ----------
    uplink : str
        Endpoint of the remote router.
    tokens : collection of str
        Liveliness tokens of the services that are to be started.
    profiles : mapping of str to mapping
        Profiles that the supervisor will serve, by scope.

    Raises
    ------
    ConflictError
        If services of the same scopes run there already.
    ConfigurationError
        If a robot cannot join the mission of the ground.
    """
    from cdff_common.bus import Bus, keys

    if not _is_served(uplink.partition("/")[2]):
        return
    own_keys = {*tokens, *(keys.alive(scope, "supervisor") for scope in profiles)}
    with Bus.open(uplink, name="cdff up") as bus:
        _check_unclaimed(bus, uplink, own_keys)
        if GROUND not in profiles:
            _check_mission(bus, profiles)


def _check_unclaimed(bus: Bus, uplink: str, tokens: Collection[str]) -> None:
    from cdff_common.bus import keys

    until_s = monotonic_s() + _ENDED_S
    while claimed := sorted(set(tokens) & bus.alive(keys.alive("*", "*"))):
        if monotonic_s() > until_s:
            scope, service = claimed[0].split("/")[2], claimed[0].split("/")[-1]
            if scope == GROUND:
                raise ConflictError(
                    f"uplink {uplink}: a ground runs there already ({service}); start a robot only, with "
                    "--scopes ROBOT, or end the other ground"
                )
            raise ConflictError(
                f"uplink {uplink}: robot {scope} runs there already ({service}); end it, or give this "
                "robot another id in its profile"
            )
        time.sleep(0.2)


def _check_mission(bus: Bus, profiles: Mapping[str, Mapping[str, Any]]) -> None:
    """Compare the profiles of robots with that of the ground, which repeats it when they join."""
    from pydantic import ValidationError

    from cdff_common.bus import keys
    from cdff_common.interfaces.profile import Profile
    from cdff_common.interfaces.robot_profile import RobotProfile

    try:
        answer = bus.call(keys.supervisor_rpc(GROUND, "profile"), timeout_s=_TIMEOUT_S)
        ground = Profile.model_validate(answer.body())
    except (UnavailableError, ValidationError):  # no ground yet, or one of another version
        return
    for robot, profile in profiles.items():
        RobotProfile.from_dict(profile, robot).check_joins(ground)


def _in_use(data_dir: Path, holder: str) -> str:
    return (
        f"data directory {data_dir}: in use by process {holder}; end it, or choose another one with "
        "--data-dir"
    )


def _is_served(address: str) -> bool:
    """Return True if a process accepts connections at ``host:port``."""
    host, _, port = address.partition("#")[0].rpartition(":")
    if not port.isdigit():
        return False
    host = _ALL_INTERFACES.get(host, host).strip("[]")
    try:
        socket.create_connection((host, int(port)), timeout=_TIMEOUT_S).close()
    except OSError:
        return False
    return True
