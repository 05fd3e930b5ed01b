# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The end of a robot: it opens a session in each window, sends its items, and executes requests."""

from __future__ import annotations

import logging
import queue
import random
import threading
from collections.abc import Callable
from typing import Any

from cdff_common.bus import keys
from cdff_common.bus.contact_session import ContactSession
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, CodecError, StorageError
from cdff_common.interfaces.contact_plan import ContactPlan, ContactWindow
from cdff_common.interfaces.profile import Exchange
from dpm_store.exchange.ledger import Ledger, RequestRow
from services.contact.changes import apply_on_robot
from services.contact.conditions import ExchangeAlarms
from services.contact.connector import Connector
from services.contact.outgoing import Outgoing
from services.contact.pacing import Pacer
from services.contact.packets import Kind, pack, unpack
from services.contact.requests import PRUNE_S, prune
from services.dpm.operations.dpm import Dpm

logger = logging.getLogger(__name__)

#: Executes a request: its parameters and the seconds until it expires; returns the answer.
Execute = Callable[[dict[str, str], float], dict[str, Any]]

_STEP_S, _IDLE_S = 0.002, 0.02
#: Periods of greetings without an answer, and of those when there is nothing to send.
_HELLO_S, _IDLE_HELLO_S = 0.2, 0.5
#: Periods of answers that are not noted, of looks at the store, and of looks for lost packets.
_RESULT_S, _SCAN_S, _EXPIRE_S = 0.5, 0.2, 0.1
#: Longest wait for the execution of a request when the end is closed.
_STOP_S = 2.0
#: Time between attempts on a full disk.
_STORAGE_S = 2.0
#: Time without a packet from the ground, in addition to the round trip, after which another session is
#: opened; and the number of acknowledgements that are missing in a row while packets are in flight.
_SILENCE_S, _SILENT_ACKS = 1.5, 3


class RobotEnd:
    """Thread that exchanges data with the ground.

    Parameters
    ----------
    robot : str
    dpm : Dpm
        Store on the robot.
    plan : ContactPlan
    endpoint : str
        Zenoh endpoint of the ground.
    exchange : Exchange
        Priorities and budget.
    execute : callable
        Called in a thread of its own.
    """

    def __init__(
        self, robot: str, dpm: Dpm, plan: ContactPlan, endpoint: str, exchange: Exchange, execute: Execute
    ) -> None:
        self._robot, self._dpm, self._plan = robot, dpm, plan
        self._exchange, self._execute = exchange, execute
        self._ledger = Ledger(dpm.store.directory)
        self.outgoing = Outgoing(robot, dpm, self._ledger, exchange)
        self._inbox: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._pacer = Pacer()
        self._connector = Connector(endpoint)
        self._session: ContactSession | None = None
        self._window: ContactWindow | None = None
        self._epoch, self._is_welcome = 0, False
        self._heard_s = self._hello_s = self._scan_s = self._expire_s = self._result_s = 0.0
        self._prune_s = 0.0
        self._round_trip_s, self._ack_s = 0.0, 0.1
        self._alarms = ExchangeAlarms(dpm.alarms, plan, dpm.clock)
        self._requests: queue.SimpleQueue[RequestRow | None] = queue.SimpleQueue()
        self._ended = threading.Event()
        for row in self._ledger.requests("accepted"):
            self._requests.put(row)
        self._threads = [
            threading.Thread(target=dpm.loops.add("contact").run, args=(self._wait, self._step), daemon=True),
            threading.Thread(
                target=dpm.loops.add("contact requests").run,
                args=(self._requests.get, self._execute_one),
                daemon=True,
            ),
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """End the threads; unsent items remain."""
        self._ended.set()
        self._requests.put(None)
        self._threads[0].join()
        self._threads[1].join(_STOP_S)  # it may wait for the orchestrator
        self._end_session()
        self._connector.close()
        self._ledger.close()

    def status(self) -> dict[str, Any]:
        """Return contact, number and bytes of the products to send by priority, and counters."""
        sender = self.outgoing.sender
        return {
            "robot": self._robot,
            "contact": self._is_welcome,
            "backlog": {str(k): v for k, v in self.outgoing.backlog().items()},
            "packets": sender.packets,
            "bytes_sent": sender.bytes_sent,
            "bytes_resent": sender.bytes_resent,
        }

    def _wait(self) -> float | None:
        """Wait for a packet or the next step; None ends the loop."""
        pause_s = _STEP_S if self._session is not None else _IDLE_S
        self._ended.wait(pause_s)
        return None if self._ended.is_set() else monotonic_s()

    def _step(self, now_s: float) -> None:
        window = self._plan.current(self._robot, self._dpm.clock.now_ns())
        if now_s >= self._scan_s:
            self._scan_s = now_s + _SCAN_S
            self._scan()
        if window != self._window:
            self._end_session()
            self._window = window
        if window is None:
            self._connector.stop()
            return
        budget = self._exchange.budget_bit_s
        self._pacer.set_rate(window.rate_bit_s if budget is None else min(window.rate_bit_s, budget))
        self._pacer.update(now_s)
        self._ack_s = ack_period_s(window)
        self._round_trip_s = 2.0 * window.delay_s + 4.0 * self._ack_s
        while not self._inbox.empty():
            self._receive(self._inbox.get(), monotonic_s())
        now_s = monotonic_s()
        is_silent = self._is_silent(now_s)
        if self._is_welcome and not is_silent:
            self._connector.stop()
        else:
            self._connector.poll(now_s, window.delay_s)
        if is_silent and (session := self._connector.take()) is not None:
            self._begin_session(session, now_s)
            is_silent = False
        if self._session is not None:
            self._send(window, now_s, is_silent)

    def _is_silent(self, now_s: float) -> bool:
        """Return whether there is no session, or the ground does not answer in it."""
        if self._session is None:
            return True
        limit_s = self._round_trip_s + (_SILENCE_S if self._is_welcome else 0.0)
        if self.outgoing.sender.oldest_s < now_s - self._round_trip_s:
            limit_s = _SILENT_ACKS * self._ack_s
        return now_s - self._heard_s > limit_s

    def _scan(self) -> None:
        """Add the new items and remove old requests; on a full disk later."""
        try:
            self.outgoing.scan()
            if self._scan_s > self._prune_s:
                self._prune_s = self._scan_s + PRUNE_S
                prune(self._ledger, self._dpm.clock.now_ns())
        except StorageError as error:
            self._alarms.storage_failed(self._robot, error)
            self._scan_s += _STORAGE_S
        else:
            self._alarms.storage_works(self._robot)

    def _begin_session(self, session: ContactSession, now_s: float) -> None:
        """Use an open session; data are sent at once, before the ground reports its intervals."""
        self._end_session()
        self._session = session
        session.receive(keys.contact(self._robot, "up"), lambda _, data: self._inbox.put(data))
        self._epoch = random.getrandbits(32)
        self._hello_s, self._heard_s = 0.0, now_s
        self.outgoing.sender.begin(self._epoch)

    def _end_session(self) -> None:
        if self._session is not None:
            self._connector.discard(self._session)
            self._session = None
        self._is_welcome = False

    def _send(self, window: ContactWindow, now_s: float, is_silent: bool) -> None:
        sender = self.outgoing.sender
        if (is_silent or not self._is_welcome) and now_s >= self._hello_s:
            self._hello_s = now_s + _HELLO_S
            self._greet()
        if is_silent:
            return
        if self._is_welcome:
            self._send_results(now_s)
            if now_s >= self._expire_s:
                self._expire_s = now_s + _EXPIRE_S
                sender.expire(now_s, 1.0 + self._round_trip_s)
        while self._pacer.is_free and not sender.is_limited(window.rate_bit_s, self._round_trip_s):
            packet = sender.next_packet(now_s)
            if packet is None:
                self._keep_alive(now_s)
                return
            self._put(packet)

    def _keep_alive(self, now_s: float) -> None:
        """Greet the ground if there was nothing to send, so that both sides know that the link exists."""
        if now_s - max(self._heard_s, self._hello_s) > _IDLE_HELLO_S:
            self._hello_s = now_s
            self._greet()

    def _greet(self) -> None:
        backlog = [[k, *v] for k, v in sorted(self.outgoing.backlog().items())]
        now_ns = self._dpm.clock.now_ns()
        fields = (self._epoch, self.outgoing.store_id, backlog, now_ns, self.outgoing.oldest)
        self._put(pack(Kind.HELLO, *fields))

    def _put(self, packet: bytes) -> None:
        assert self._session is not None
        self._pacer.spend(packet)
        self._session.send(keys.contact(self._robot, "down"), packet)

    def _receive(self, data: bytes, now_s: float) -> None:
        try:
            kind, fields = unpack(data)
            self._handle(kind, fields, now_s)
        except StorageError as error:
            self._alarms.storage_failed(self._robot, error)
        except (CodecError, ValueError, TypeError, LookupError) as error:
            logger.warning("a packet from the ground is not readable: %s", error)

    def _handle(self, kind: Kind, fields: list[Any], now_s: float) -> None:
        self._heard_s = now_s
        match kind:
            case Kind.WELCOME if fields[0] == self._epoch and not self._is_welcome:
                self._is_welcome = True
                self.outgoing.sender.resume(fields[1])
            case Kind.ACK if fields[0] == self._epoch:
                _, low, high, missing, done, wanted = fields
                self.outgoing.sender.acknowledge(low, high, missing)
                self.outgoing.done(done)
                for key, ranges in wanted:
                    self.outgoing.want(key, ranges)
            case Kind.REQUEST:
                self._accept(*fields)
            case Kind.FIRST:
                for product_id in fields[0]:
                    self.outgoing.prioritise(str(product_id))
            case Kind.NOTED:
                self._ledger.set_request(fields[0], "answered")

    def _accept(self, request_id: str, body: dict[str, str], expires_ns: int) -> None:
        row = RequestRow(
            request_id, self._robot, "accepted", self._dpm.clock.now_ns(), expires_ns, body, None
        )
        if self._ledger.add_request(row):
            self._requests.put(row)
        self._put(pack(Kind.TAKEN, request_id))

    def _send_results(self, now_s: float) -> None:
        if now_s < self._result_s:
            return
        self._result_s = now_s + _RESULT_S + self._round_trip_s
        for row in self._ledger.requests("executed"):
            if row.result is not None and row.result.get("id"):
                self.outgoing.prioritise(str(row.result["id"]))
            self._put(pack(Kind.RESULT, row.id, row.result))

    def _execute_one(self, row: RequestRow) -> None:
        """Execute an accepted request, and note the answer; both are tried again while the disk is full."""
        result: dict[str, Any] | None = None
        while not self._ended.is_set():
            try:
                if result is None:
                    result = self._result_of(row)
                self._ledger.set_request(row.id, "executed", result)
            except StorageError as error:
                self._alarms.storage_failed(self._robot, error)
                self._ended.wait(_STORAGE_S)
            else:
                self._result_s = 0.0
                return

    def _result_of(self, row: RequestRow) -> dict[str, Any]:
        """Return the answer of a request; raises StorageError if a change cannot be written now."""
        left_s = (row.expires_ns - self._dpm.clock.now_ns()) / 1e9
        if left_s <= 0:
            return {"error": "expired before the robot could execute it"}
        try:
            if "change" not in row.body:
                return self._execute(row.body, left_s)
            return apply_on_robot(self._dpm, row.body)
        except StorageError:
            raise
        except CdffError as error:
            return {"error": str(error)}


def ack_period_s(window: ContactWindow) -> float:
    """Return the period of acknowledgements: 0.1 s, or longer so that they use a tenth of a slow uplink."""
    return max(0.1, 10 * 250 * 8 / window.up_rate_bit_s)
