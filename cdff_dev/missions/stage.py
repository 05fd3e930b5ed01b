# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a mission or demonstration: the system and the player, started and ended together."""

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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from cdff_common.bus import Bus, keys
from cdff_common.errors import ConfigurationError, UnavailableError
from cdff_common.interfaces.profile import Profile
from cdff_dev.ports import split_address

#: Longest time until the system is ready, seconds; at the first start, kernels are compiled. The end of a
#: process is reported at once.
READY_S = 300.0
#: Longest time for the processes to end, seconds: more than the supervisor's own limits.
END_S = 3.5
#: Longest time for simulated rovers to end and to write the true poses, seconds.
DRIVE_END_S = 30.0
#: The mission clock is stopped while the lag of a DFPC exceeds this, mission seconds.
PATIENCE_S = 2.0


def check_port_is_free(host: str, port: int, name: str) -> None:
    """Raise ConfigurationError if a port is in use."""
    with socket.socket() as probe:
        probe.settimeout(0.3)
        if probe.connect_ex((host, port)) == 0:
            raise ConfigurationError(
                f"{name} {host}:{port} is in use: is another system running? End it or choose another port"
            )


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C and SIGTERM until the end of the block, so that every started process is recorded.

    The signals are delayed by handlers: a signal mask would be inherited by the started process. In other
    threads than the main thread, which are not interrupted by signals, the block is run unchanged.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    previous = {
        n: signal.signal(n, lambda number, _frame: received.append(number))
        for n in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        if received:
            raise KeyboardInterrupt


@dataclass(slots=True)
class Stage:
    """The processes of a running system and its player; as a context manager it starts and ends them.

    Parameters
    ----------
    connect, http : str
        Endpoint of the router, such as ``tcp/127.0.0.1:7447``, and ``host:port`` of the HTTP server.
    data_dir : Path or None
        Data folder of the system. None: a new folder, which is removed at the end, unless an error occurs or
        ``keep`` is set.
    keep : bool
        Do not remove the new data folder.
    scopes : tuple of str
        Robots, and ``ground``, whose services are started; empty for all.
    uplink : str
        Endpoint of a remote router to link to; empty for none.
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
        check_port_is_free(*split_address(self.connect, "router"), "the router's endpoint")
        check_port_is_free(*split_address(self.http, "http"), "the HTTP address")
        if self.data_dir is None:
            self._scratch = self.data_dir = Path(tempfile.mkdtemp(prefix="cdff-demo-"))
        self._spawn(
            "up",
            profile=self.profile_path,
            connect=self.connect,
            http=self.http,
            data_dir=self.data_dir,
            log_dir=self.log_dir,
            scopes=self.scopes or None,
            uplink=self.uplink or None,
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
        """Folder of the logs of the processes."""
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
        scopes = self.scopes or (keys.GROUND, *self.profile.robot_ids)
        robots = [robot for robot in self.profile.robots if robot.id in scopes]
        shared = ("dpm", "orchestrator", "icu", *merging) if keys.GROUND in scopes else ()
        ground_tokens = {keys.alive(keys.GROUND, service) for service in shared}
        router = keys.alive(keys.GROUND if shared else robots[0].id, "router")
        return {router} | ground_tokens | {keys.alive(r.id, d.name) for r in robots for d in r.dfpcs}

    def wait_ready(
        self,
        bus: Bus,
        on_progress: Callable[[int, int], None] = lambda *_: None,
        timeout_s: float = READY_S,
    ) -> None:
        """Wait until every service is alive; raises UnavailableError that names the missing ones.

        ``on_progress`` is called with the number of services that are alive and their total number.
        """
        deadline_s = time.monotonic() + timeout_s
        reported = -1
        while True:
            alive = bus.alive("cdff/@v1/*/@alive/*") & self.expected
            if len(alive) != reported:
                reported = len(alive)
                on_progress(reported, len(self.expected))
            if alive == self.expected:
                return
            self.check_running()
            if time.monotonic() > deadline_s:
                missing = ", ".join(sorted(self.expected - alive))
                raise UnavailableError(
                    f"not ready after {timeout_s:g} s: {missing}; their logs are in {self.log_dir}"
                )
            time.sleep(0.2)

    def play(self, log: str, rate: float, via: Mapping[str, str] | None = None) -> None:
        """Start the player; ``via`` maps a robot with a router of its own to the endpoint of that router."""
        routers = [f"{robot}={endpoint}" for robot, endpoint in (via or {}).items()]
        self._spawn("play", log, speed=rate, patience=PATIENCE_S, via=routers or None)

    def drive(self, scenario: str, seed: int, rate: float, truth: Path) -> None:
        """Start simulated rovers that execute drive commands, instead of a player.

        The true poses are written to the log ``truth``.
        """
        self._spawn("drive", scenario, seed=seed, speed=rate, patience=PATIENCE_S, truth=truth)

    def end_drive(self) -> None:
        """End the simulated rovers, which completes the log of true poses; the system continues to run."""
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
                lines = (
                    (self.log_dir / f"{name}.log").read_text(encoding="utf-8", errors="replace").splitlines()
                )
                last_line = lines[-1] if lines else "no output"
                raise UnavailableError(f"`cdff {name}` ended with code {process.returncode}: {last_line}")

    def end(self) -> None:
        """Send SIGTERM to the player and the system, and SIGKILL to processes that do not end."""
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

    def _spawn(self, noun: str, *operands: str, **options: object) -> None:
        """Start ``cdff NOUN``; an option that is None is omitted, a sequence is passed as several values."""
        command = [noun, *operands]
        for name, value in options.items():
            if value is not None:
                values = value if isinstance(value, list | tuple) else (value,)
                command += [f"--{name.replace('_', '-')}", *map(str, values)]
        self.log_dir.mkdir(parents=True, exist_ok=True)
        environment = {
            **os.environ,
            "CDFF_CONNECT": self.connect,
            "CDFF_PROFILE": str(self.profile_path.resolve()),
            "CDFF_SUPERVISOR": str(os.getpid()),
        }
        with (self.log_dir / f"{noun}.log").open("ab") as output, uninterrupted():
            self._processes[noun] = subprocess.Popen(
                [sys.executable, "-m", "cdff_common.cli", *command],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
