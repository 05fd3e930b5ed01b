# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a demonstration: the system and the player, started, watched and ended together."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from cdff_common.bus import Bus, keys
from cdff_common.errors import ConfigurationError, UnavailableError
from cdff_common.interfaces.profile import Profile

#: How long the system may take to be ready, and to end, seconds.
READY_S = 90.0
END_S = 3.5
#: How long simulated rovers may take to end and to write the truth, seconds.
DRIVE_END_S = 30.0
#: The clock of the mission is held while a DFPC is further behind, mission seconds.
PATIENCE_S = 2.0


def check_free(host: str, port: int, what: str) -> None:
    """Raise ConfigurationError if something listens on a port already."""
    with socket.socket() as probe:
        probe.settimeout(0.3)
        if probe.connect_ex((host, port)) == 0:
            raise ConfigurationError(
                f"{what} {host}:{port} is in use: is another system running? End it or choose another port"
            )


def _split(text: str, what: str) -> tuple[str, int]:
    host, _, port = text.removeprefix("tcp/").rpartition(":")
    if not host or not port.isdigit():
        raise ConfigurationError(f"{what} {text!r}: expected host:port")
    return host, int(port)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put off Ctrl-C and SIGTERM until the block is done: a process just started must be known before we give up.

    Put off by handlers, not by a mask, which the process would inherit. Only the main thread is interrupted.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {n: signal.signal(n, lambda number, _frame: came.append(number)) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            raise KeyboardInterrupt


@dataclass(slots=True)
class Stage:
    """The running system of a profile, with a player; a context manager that leaves nothing behind.

    Parameters
    ----------
    profile, profile_path
        The mission.
    connect : str
        Endpoint of the router, as ``tcp/127.0.0.1:7447``.
    http : str
        ``host:port`` of the HTTP server.
    data_dir : Path or None
        None takes a fresh folder, removed at the end unless something went wrong or ``keep`` is set.
    keep : bool
        Keep a fresh data folder.
    scopes : tuple of str
        Whose services: robots, and ``ground``; empty for all. Others run elsewhere.
    uplink : str
        Endpoint of the router elsewhere that the one here links to; empty for none.
    """

    profile: Profile
    profile_path: Path
    connect: str
    http: str
    data_dir: Path | None = None
    keep: bool = False
    scopes: tuple[str, ...] = ()
    uplink: str = ""
    _scratch: Path | None = None
    _processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def __enter__(self) -> Self:
        check_free(*_split(self.connect, "router"), "the router's endpoint")
        check_free(*_split(self.http, "http"), "the HTTP address")
        if self.data_dir is None:
            self._scratch = self.data_dir = Path(tempfile.mkdtemp(prefix="cdff-demo-"))
        self._spawn(
            "up",
            "--profile",
            str(self.profile_path),
            "--connect",
            self.connect,
            "--http",
            self.http,
            "--data-dir",
            str(self.data_dir),
            "--log-dir",
            str(self.log_dir),
            *(("--scopes", *self.scopes) if self.scopes else ()),
            *(("--uplink", self.uplink) if self.uplink else ()),
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
        if self._scratch is not None and kind is None and not self.keep:
            shutil.rmtree(self._scratch, ignore_errors=True)

    @property
    def log_dir(self) -> Path:
        """Where each process writes its log."""
        assert self.data_dir is not None
        return self.data_dir / "logs"

    @property
    def supervisor_pid(self) -> int:
        """Process id of ``cdff up``, whose children the services are."""
        return self._processes["up"].pid

    @property
    def expected(self) -> set[str]:
        """Liveliness tokens of a system that is ready."""
        merging = () if self.profile.merging is None else ("map_merging",)
        chosen = self.scopes or (keys.GROUND, *self.profile.robot_ids)
        robots = [robot for robot in self.profile.robots if robot.id in chosen]
        shared = ("dpm", "orchestrator", "icu", *merging) if keys.GROUND in chosen else ()
        services = {keys.alive(keys.GROUND, service) for service in shared}
        router = keys.alive(keys.GROUND if shared else robots[0].id, "router")
        return {router} | services | {keys.alive(r.id, d.name) for r in robots for d in r.dfpcs}

    def wait_ready(self, bus: Bus, on_progress: object = None) -> None:
        """Return when every service has announced itself; raises UnavailableError naming those that have not."""
        deadline_s = time.monotonic() + READY_S
        shown = -1
        while True:
            alive = bus.alive("cdff/@v1/*/@alive/*") & self.expected
            if callable(on_progress) and len(alive) != shown:
                shown = len(alive)
                on_progress(shown, len(self.expected))
            if alive == self.expected:
                return
            self.check_running()
            if time.monotonic() > deadline_s:
                missing = ", ".join(sorted(self.expected - alive))
                raise UnavailableError(f"not ready after {READY_S:g} s: {missing}; their logs are in {self.log_dir}")
            time.sleep(0.2)

    def play(self, log: str, rate: float, via: Mapping[str, str] | None = None) -> None:
        """Start the player; ``via`` has the routers of robots that have one of their own."""
        elsewhere = [f"{robot}={endpoint}" for robot, endpoint in (via or {}).items()]
        self._spawn(
            "play", log, "--speed", str(rate), "--patience", str(PATIENCE_S),
            *(("--via", *elsewhere) if elsewhere else ()),
        )  # fmt: skip

    def drive(self, scenario: str, seed: int | None, rate: float, truth: Path) -> None:
        """Start simulated rovers that take orders, instead of a player; the true poses go to a log."""
        seeded = () if seed is None else ("--seed", str(seed))
        self._spawn(
            "drive", scenario, *seeded, "--speed", str(rate), "--patience", str(PATIENCE_S), "--truth", str(truth)
        )

    def end_drive(self) -> None:
        """End the simulated rovers, whose truth is whole then; the system runs on."""
        process = self._processes.pop("drive")
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(DRIVE_END_S)
        except subprocess.TimeoutExpired as error:
            process.kill()
            raise UnavailableError(f"`cdff drive` did not end within {DRIVE_END_S:g} s") from error

    def check_running(self) -> None:
        """Raise UnavailableError if the system or the player has ended."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                lines = (self.log_dir / f"{name}.log").read_text(encoding="utf-8", errors="replace").splitlines()
                last = lines[-1] if lines else "it said nothing"
                raise UnavailableError(f"`cdff {name}` ended with code {process.returncode}: {last}")

    def end(self) -> None:
        """SIGTERM to the player and the system; SIGKILL to what stays."""
        for process in reversed(self._processes.values()):
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        deadline_s = time.monotonic() + END_S
        for process in reversed(self._processes.values()):
            try:
                process.wait(max(deadline_s - time.monotonic(), 0.05))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._processes.clear()

    def _spawn(self, *arguments: str) -> None:
        self.log_dir.mkdir(parents=True, exist_ok=True)
        environment = {
            **os.environ,
            "CDFF_CONNECT": self.connect,
            "CDFF_PROFILE": str(self.profile_path.resolve()),
            "CDFF_SUPERVISOR": str(os.getpid()),
        }
        with (self.log_dir / f"{arguments[0]}.log").open("ab") as output, uninterrupted():
            self._processes[arguments[0]] = subprocess.Popen(
                [sys.executable, "-m", "cdff_common.cli", *arguments],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
