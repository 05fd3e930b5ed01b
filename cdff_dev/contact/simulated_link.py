# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated radio link: a relay of UDP datagrams with a rate, a delay, loss and outages in each direction.

The loss is a sequence of independent draws from a seed. A datagram that does not fit in the queue of the
radio is dropped, as by a real one.
"""

from __future__ import annotations

import heapq
import itertools
import random
import selectors
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

_STEP_S = 0.002
#: Bytes that a radio queues.
QUEUE_BYTES = 1 << 16


@dataclass(slots=True)
class Direction:
    """One direction of the link.

    Attributes
    ----------
    rate_bit_s, delay_s, loss
        Rate, one-way delay, and share of the datagrams that are lost.
    passed_bytes, lost, overflowed : int
        Bytes that were passed, datagrams that were lost, and those for which the queue was full.
    """

    rate_bit_s: float
    delay_s: float = 0.0
    loss: float = 0.0
    passed_bytes: int = 0
    lost: int = 0
    overflowed: int = 0
    _free_s: float = field(default=0.0)

    def arrival_s(self, nbytes: int, now_s: float, draw: float) -> float | None:
        """Return the time at which a datagram arrives; None if it is lost."""
        start_s = max(now_s, self._free_s)
        if (start_s - now_s) * self.rate_bit_s / 8.0 + nbytes > QUEUE_BYTES:
            self.overflowed += 1
            return None
        self._free_s = start_s + nbytes * 8.0 / self.rate_bit_s
        self.passed_bytes += nbytes
        if draw < self.loss:
            self.lost += 1
            return None
        return self._free_s + self.delay_s


class SimulatedLink:
    """Context manager that relays datagrams between robots and the ground.

    Parameters
    ----------
    to : tuple of (str, int)
        UDP address of the ground.
    down, up : Direction
        From the robot, and to it.
    seed : int
        Of the loss.
    outages_s : sequence of (float, float)
        Start and end of times without a link, seconds after the start of the relay.

    Attributes
    ----------
    port : int
        UDP port on loopback to which the robot connects.
    """

    def __init__(
        self,
        to: tuple[str, int],
        down: Direction,
        up: Direction,
        seed: int = 0,
        outages_s: Sequence[tuple[float, float]] = (),
    ) -> None:
        self._to, self.down, self.up = to, down, up
        self._random = random.Random(seed)
        self._outages_s = tuple(outages_s)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self._robots: dict[tuple[str, int], socket.socket] = {}
        self._addresses: dict[socket.socket, tuple[str, int]] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._socket, selectors.EVENT_READ)
        self._waiting: list[tuple[float, int, bytes, socket.socket, bool]] = []
        self._numbers = itertools.count()
        self._ended, self._is_cut = threading.Event(), threading.Event()
        self._is_up_cut = threading.Event()
        self._start_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="simulated link", daemon=True)

    def __enter__(self) -> Self:
        self._start_s = time.monotonic()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        for connection in (self._socket, *self._robots.values()):
            connection.close()

    def cut(self) -> None:
        """Lose every datagram from now on."""
        self._is_cut.set()

    def cut_up(self) -> None:
        """Lose every datagram to the robots from now on."""
        self._is_up_cut.set()

    def restore(self) -> None:
        """Pass datagrams again."""
        self._is_cut.clear()
        self._is_up_cut.clear()

    def is_out(self, now_s: float) -> bool:
        """Return whether the link is interrupted at a monotonic time."""
        since_s = now_s - self._start_s
        return self._is_cut.is_set() or any(start <= since_s < end for start, end in self._outages_s)

    def _run(self) -> None:
        while not self._ended.is_set():
            for key, _ in self._selector.select(_STEP_S):
                if isinstance(key.fileobj, socket.socket):
                    self._take(key.fileobj)
            now_s = time.monotonic()
            while self._waiting and self._waiting[0][0] <= now_s:
                self._deliver(*heapq.heappop(self._waiting)[2:])

    def _take(self, source: socket.socket) -> None:
        try:
            data, address = source.recvfrom(1 << 16)
        except OSError:  # the other side is not there now
            return
        now_s, is_down = time.monotonic(), source is self._socket
        if is_down and address not in self._robots:
            self._add(address)
        draw = self._random.random()
        if self.is_out(now_s) or (self._is_up_cut.is_set() and not is_down):
            return
        arrival_s = (self.down if is_down else self.up).arrival_s(len(data), now_s, draw)
        if arrival_s is not None:
            ground = self._robots[address] if is_down else source
            heapq.heappush(self._waiting, (arrival_s, next(self._numbers), data, ground, is_down))

    def _add(self, address: tuple[str, int]) -> None:
        ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        ground.connect(self._to)
        self._robots[address], self._addresses[ground] = ground, address
        self._selector.register(ground, selectors.EVENT_READ)

    def _deliver(self, data: bytes, ground: socket.socket, is_down: bool) -> None:
        try:
            if is_down:
                ground.send(data)
            else:
                self._socket.sendto(data, self._addresses[ground])
        except OSError:  # no process listens there now: lost
            return
