# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mission under test: ``cdff up --secure`` on small disks, its processes, and buses of identities."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from unittest.mock import patch

import psutil

from cdff_common.bus import Bus, keys
from cdff_common.bus.identity import VARIABLE
from cdff_common.bus.message import on_map
from cdff_common.client import Client
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.interfaces import registry
from cdff_common.interfaces.profile import load_profile
from cdff_dev.ports import free_port
from services.keys.access_control import Kind
from services.keys.mission_keys import MissionKeys
from services.supervisor.plan import plan
from tests.chaos.disks import SmallDisks
from tests.chaos.process_clocks import ProcessClocks
from tests.integration.conftest import PLUGIN, ROOT
from tests.support.identities import open_as

PROFILE = Path(__file__).with_name("mission.yaml")
READY_S = 120.0
#: Age of the last publication of an active alarm, which is repeated every 2 s.
_PUBLISHED_S = 5.0
OPERATOR, PLAYER = "alice", "player"


@dataclass(slots=True)
class Mission:
    """A running mission in a folder; as a context manager it starts and ends it."""

    folder: Path
    endpoint: str = field(default_factory=lambda: f"tls/127.0.0.1:{free_port()}")
    http_port: int = field(default_factory=free_port)
    _up: subprocess.Popen[bytes] | None = None
    _buses: dict[str, Bus] = field(default_factory=dict)
    _client: Client | None = None
    _published_s: dict[tuple[str, str], float] = field(default_factory=dict)
    _disks: SmallDisks = field(init=False)
    _clocks: ProcessClocks = field(init=False)
    _modules: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._disks = SmallDisks(self.data)
        self._clocks = ProcessClocks(self.folder / "clocks")

    @property
    def data(self) -> Path:
        """Data folder of the services."""
        return self.folder / "data"

    @property
    def secrets(self) -> Path:
        """Folder of the identities."""
        return self.folder / "secrets"

    @property
    def disks(self) -> SmallDisks:
        """The file systems of the mission."""
        return self._disks

    @property
    def clocks(self) -> ProcessClocks:
        """The wall clocks of the services."""
        return self._clocks

    def __enter__(self) -> Self:
        if str(PLUGIN) not in sys.path:
            sys.path.append(str(PLUGIN))  # the DFPCs of the profile
            registry._default_registry.cache_clear()  # another test may have read it without them
        profile = load_profile(PROFILE)
        identities = MissionKeys.create(self.secrets, profile, ())
        for robot in profile.robot_ids:
            identities.issue(robot, Kind.ROBOT)
        identities.issue(OPERATOR, Kind.OPERATOR)
        identities.issue(PLAYER, Kind.PLAYER)
        self._disks.mount()
        self._clocks.build()
        address = f"127.0.0.1:{self.http_port}"
        specs = plan(
            profile,
            PROFILE,
            connect=self.endpoint,
            http=address,
            data_dir=self.data,
            secrets=self.secrets,
        )
        self._modules = {spec.name: spec.argv[1:] for spec in specs}
        environment = {
            **os.environ,
            **self._clocks.environment(),
            "PYTHONPATH": os.pathsep.join([str(ROOT), str(PLUGIN)]),
        }
        options = ["--profile", PROFILE, "--connect", self.endpoint, "--http", address]
        options += ["--data-dir", self.data, "--log-dir", self.folder / "logs", "--secure", self.secrets]
        with (self.folder / "up.log").open("ab") as log:
            self._up = subprocess.Popen(
                [sys.executable, "-m", "cdff_common.cli", "up", *map(str, options)],
                cwd=ROOT,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        try:
            for name in (OPERATOR, PLAYER, *profile.robot_ids):
                self._buses[name] = open_as(self.secrets / name, self.endpoint, wait_s=READY_S)
            self.bus(OPERATOR).subscribe(keys.alarms("*", "*"), on_map(self._on_alarms))
            with patch.dict("os.environ", {VARIABLE: str(self.secrets / OPERATOR)}):
                self._client = Client(self.endpoint)
            if not self.wait_ready():
                raise UnavailableError(f"the mission is not ready; its logs are in {self.folder / 'logs'}")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the mission and unmount its disks."""
        if self._client is not None:
            self._client.close()
        for bus in self._buses.values():
            bus.close()
        if self._up is not None:
            self._up.send_signal(signal.SIGTERM)
            try:
                self._up.wait(15)
            except subprocess.TimeoutExpired:
                self._up.kill()
                self._up.wait()
        self._disks.unmount()

    def bus(self, identity: str) -> Bus:
        """Return the open bus of an identity."""
        return self._buses[identity]

    @property
    def client(self) -> Client:
        """Client with the identity of the operator."""
        assert self._client is not None
        return self._client

    @property
    def services(self) -> tuple[str, ...]:
        """Names of the processes."""
        return tuple(self._modules)

    @property
    def robots(self) -> tuple[str, ...]:
        """Ids of the robots."""
        return tuple(name for name in self._buses if name not in (OPERATOR, PLAYER))

    def robots_of(self, service: str) -> tuple[str, ...]:
        """Return the robots whose DFPCs a process hosts."""
        return tuple(robot for robot in self.robots if service.startswith(robot))

    def process(self, name: str) -> psutil.Process | None:
        """Return the present process of a service; None between its end and its restart."""
        assert self._up is not None
        for child in psutil.Process(self._up.pid).children():
            try:
                if tuple(child.cmdline()[1:]) == self._modules[name]:
                    return child
            except psutil.Error:  # the process has just ended
                continue
        return None

    def resources(self) -> dict[str, tuple[float, int, int]]:
        """Return resident memory in MB, descriptors and threads of each running service."""
        result = {}
        for name in self.services:
            process = self.process(name)
            try:
                if process is not None:
                    used_mb = round(process.memory_info().rss / 1e6, 1)
                    result[name] = used_mb, process.num_fds(), process.num_threads()
            except psutil.Error:
                continue
        return result

    def memory_mb(self) -> dict[str, float]:
        """Return the resident memory of the running services."""
        return {name: resources[0] for name, resources in self.resources().items()}

    def is_ready(self) -> bool:
        """Return whether every service is alive and the DPM answers."""
        expected = {keys.alive(keys.GROUND, s) for s in ("router", "dpm", "orchestrator", "icu")}
        profile = load_profile(PROFILE)
        expected |= {keys.alive(robot.id, entry.name) for robot in profile.robots for entry in robot.dfpcs}
        if not expected <= self.bus(OPERATOR).alive("cdff/@v1/*/@alive/*"):
            return False
        try:
            self.call("stat")
        except CdffError:
            return False
        return True

    def wait_ready(self, within_s: float = READY_S) -> bool:
        """Wait until every service is alive; return whether they are."""
        return wait_until(self.is_ready, within_s)

    def call(self, verb: str, **parameters: object) -> Any:
        """Call a verb of the DPM as the operator."""
        return self.bus(OPERATOR).call(keys.dpm_rpc("ground", verb), parameters, timeout_s=5).body()

    def has_alarm(self, kind: str, source: str) -> bool:
        """Return whether the DPM lists an alarm."""
        try:
            return any((a["kind"], a["source"]) == (kind, source) for a in self.call("alarms")["items"])
        except CdffError:
            return False

    def published_alarm(self, kind: str, source: str) -> bool:
        """Return whether a service published an alarm within the last seconds, also without a DPM."""
        return time.monotonic() - self._published_s.get((kind, source), -_PUBLISHED_S) < _PUBLISHED_S

    def _on_alarms(self, _key: str, body: dict[str, Any]) -> None:
        now_s = time.monotonic()
        self._published_s |= {(item["kind"], item["source"]): now_s for item in body["items"]}


def wait_until(condition: Callable[[], bool], within_s: float) -> bool:
    """Wait until a condition holds; return whether it does."""
    until_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.1)
    return True
