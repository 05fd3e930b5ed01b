# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The stores of a robot and of the ground as two processes that exchange products over a simulated link.

Every step has a deadline, and the processes end with the context.
"""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml

from cdff_common.errors import DeadlineError, UnavailableError
from cdff_dev.contact.generated_products import ROBOT
from cdff_dev.contact.simulated_link import Direction, SimulatedLink
from cdff_dev.ports import free_udp_port

#: Time limits of the start of a process, of a command, and of the regular end of a process, seconds.
START_S, COMMAND_S, END_S = 60.0, 30.0, 10.0
#: Period of looks at a condition.
_POLL_S = 0.02
ROBOT_SIDE, GROUND_SIDE = "robot", "ground"


class EndProcess:
    """A running ``cdff_dev.contact.end_process``.

    Raises
    ------
    DeadlineError
        If it does not answer in time.
    UnavailableError
        If it has ended.
    """

    def __init__(self, side: str, folder: Path, plan: Path, endpoint: str, options: Sequence[str]) -> None:
        self._side = side
        command = [sys.executable, "-m", "cdff_dev.contact.end_process", side, str(folder), str(plan)]
        with (folder.parent / f"{side}.log").open("ab") as log:
            self._process = subprocess.Popen(
                [*command, endpoint, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log
            )
        self._answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def wait_until_ready(self) -> None:
        """Wait until the process exchanges data."""
        self._answer(START_S)

    def call(self, name: str, **arguments: Any) -> Any:
        """Return the answer to a command."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps([name, arguments]).encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError as error:
            raise UnavailableError(f"the process of the {self._side} has ended") from error
        answer = self._answer(COMMAND_S)
        if "error" in answer:
            raise UnavailableError(f"{self._side}: {name}: {answer['error']}")
        return answer["result"]

    def kill(self) -> None:
        """End the process at once, as `kill -9` does."""
        self._process.kill()
        self._wait()

    def close(self) -> None:
        """End the process regularly; kill it if that takes too long."""
        assert self._process.stdin is not None
        if self._process.poll() is None:
            self._process.stdin.close()
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._wait()

    def _wait(self) -> None:
        self._process.wait()
        self._reader.join()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None and not stream.closed:
                try:
                    stream.close()
                except BrokenPipeError:
                    continue

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._answers.put(line)
        self._answers.put(b"")

    def _answer(self, timeout_s: float) -> dict[str, Any]:
        try:
            line = self._answers.get(timeout=timeout_s)
        except queue.Empty as error:
            raise DeadlineError(f"the {self._side} did not answer within {timeout_s:g} s") from error
        if not line:
            raise UnavailableError(f"the process of the {self._side} has ended")
        answer: dict[str, Any] = json.loads(line)
        return answer


class TwoStores:
    """Two stores in a folder with a contact plan and a simulated link; a context manager.

    Parameters
    ----------
    folder : Path
    windows_s : sequence of (float, float)
        Start and end of the windows, seconds after the call of ``open_windows``.
    down, up : Direction
        From the robot, and to it.
    seed : int
        Of the loss.

    Attributes
    ----------
    ends : dict of str to EndProcess
        The running processes by side, ``robot`` and ``ground``.
    link : SimulatedLink
    """

    def __init__(
        self,
        folder: Path,
        windows_s: Sequence[tuple[float, float]],
        down: Direction,
        up: Direction,
        seed: int = 0,
    ) -> None:
        self._folder, self._windows_s = folder, tuple(windows_s)
        self._plan, self._port = folder / "plan.yaml", free_udp_port()
        self._start_s = 0.0
        self.link = SimulatedLink(("127.0.0.1", self._port), down, up, seed)
        self.ends: dict[str, EndProcess] = {}

    def __enter__(self) -> Self:
        self.link.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for end in self.ends.values():
            end.close()
        self.link.__exit__(kind, error, trace)

    def open_windows(self, lead_s: float = 0.0) -> None:
        """Write the contact plan: its times count from ``lead_s`` seconds after now."""
        self._start_s = time.monotonic() + lead_s
        start = datetime.now(UTC) + timedelta(seconds=lead_s)
        windows = [
            {
                "robot": ROBOT,
                "start": (start + timedelta(seconds=first)).isoformat(),
                "end": (start + timedelta(seconds=last)).isoformat(),
                "rate_bit_s": self.link.down.rate_bit_s,
                "up_bit_s": self.link.up.rate_bit_s,
                "delay_s": self.link.down.delay_s,
            }
            for first, last in self._windows_s
        ]
        self._plan.write_text(yaml.safe_dump({"windows": windows}), encoding="utf-8")

    @property
    def now_s(self) -> float:
        """Time since the start of the plan, seconds."""
        return time.monotonic() - self._start_s

    def start(self, *sides: str, options: Sequence[str] = ()) -> None:
        """Start processes, which open the stores, and wait until they are ready."""
        for side in sides:
            folder = self._folder / side
            folder.mkdir(exist_ok=True)
            port = self._port if side == GROUND_SIDE else self.link.port
            self.ends[side] = EndProcess(side, folder, self._plan, f"udp/127.0.0.1:{port}", options)
        for side in sides:
            self.ends[side].wait_until_ready()

    def begin(self, lead_s: float = 0.0) -> None:
        """Write the contact plan, and start the exchange in the processes that run."""
        self.open_windows(lead_s)
        for end in self.ends.values():
            end.call("begin")

    def restart(self, side: str) -> None:
        """Start a process, and the exchange in it."""
        self.start(side)
        self.ends[side].call("begin")

    def kill(self, side: str) -> None:
        """End a process as ``kill -9`` does."""
        self.ends.pop(side).kill()

    def call(self, side: str, name: str, **arguments: Any) -> Any:
        """Return the answer of a process to a command."""
        return self.ends[side].call(name, **arguments)

    def wait_for(self, condition: Callable[[], Any], timeout_s: float, what: str) -> None:
        """Wait for a condition; raises DeadlineError after the time limit."""
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline_s:
                raise DeadlineError(f"{what} did not happen within {timeout_s:g} s")
            time.sleep(_POLL_S)
