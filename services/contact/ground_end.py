# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The end of the ground: it stores what robots send, acknowledges it, and sends requests."""

from __future__ import annotations

import logging
import queue
import threading
from pathlib import Path
from typing import Any, NamedTuple

from cdff_common.bus import keys
from cdff_common.bus.contact_session import ContactSession
from cdff_common.clock import monotonic_s
from cdff_common.contract.names import GROUND
from cdff_common.errors import CdffError, CodecError, InputError, StorageError
from cdff_common.interfaces.contact_plan import ContactPlan
from cdff_common.interfaces.profile import Exchange
from dpm_store.exchange.ledger import AnnouncedRow, Ledger
from services.contact.arrivals import Arrivals
from services.contact.changes import OLDEST, GroundChanges
from services.contact.conditions import ExchangeAlarms
from services.contact.estimate import Waiting, estimate
from services.contact.packets import Item, Kind, pack, unpack
from services.contact.receiver import Receiver
from services.contact.requests import DeferredRequests
from services.contact.robot_end import ack_period_s
from services.dpm.operations.dpm import Dpm

logger = logging.getLogger(__name__)

FOLDER = "exchange"
_STEP_S = 0.005
#: Period of commits, and of updates of the requests.
_FLUSH_S, _UPDATE_S = 0.2, 0.5
#: Period of looks at the open requests.
_REQUESTS_S = 0.02
#: Time since the last packet, in addition to the round trip, for which a robot counts as in contact.
_CONTACT_S = 3.0
#: Time for which data are ignored after the disk was full.
_BLOCKED_S = 2.0
#: Period in which the products to be sent first are repeated to the robot, and their largest number, with
#: which the packet fits in a datagram.
_FIRST_S, MAX_FIRST = 2.0, 25
#: Products in an answer.
MAX_ITEMS = 1000


class _Robot(NamedTuple):
    receiver: Receiver
    arrivals: Arrivals
    times: dict[str, float]  # of the next acknowledgement, and of the next sending of each request


class GroundEnd:
    """Threads that exchange data with the robots of a contact plan, and store the received items.

    Attributes
    ----------
    requests : DeferredRequests
    """

    def __init__(self, dpm: Dpm, plan: ContactPlan, endpoint: str, exchange: Exchange) -> None:
        self._dpm, self._plan, self._exchange = dpm, plan, exchange
        self._ledger = Ledger(dpm.store.directory)
        self.requests = DeferredRequests(dpm, self._ledger, plan)
        self._lock = threading.RLock()
        self._inbox: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._robots: dict[str, _Robot] = {}
        self._alarms = ExchangeAlarms(dpm.alarms, plan, dpm.clock)
        folder = Path(dpm.store.directory) / FOLDER
        robots = sorted({window.robot for window in plan.windows})
        self._changes = GroundChanges(dpm, self._ledger, robots, self.requests.add_change)
        for robot in robots:
            arrivals = Arrivals(robot, dpm, self._ledger, self._alarms, self._lock, self._changes)
            receiver = Receiver(robot, folder, self._ledger, arrivals, self._lock)
            self._robots[robot] = _Robot(receiver, arrivals, {})
        self._update_s = self._blocked_s = 0.0
        self._session = ContactSession.listen(endpoint)
        self._session.receive(keys.contact("*", "down"), lambda key, data: self._inbox.put((key, data)))
        self._ended = threading.Event()
        works = (
            ("contact", self._wait, self._step),
            ("contact storage", self._wait_for_flush, self._flush),
        )
        self._threads = [
            threading.Thread(target=dpm.loops.add(name).run, args=work, name=name, daemon=True)
            for name, *work in works
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """End the threads; items that were received in part remain."""
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._session.close()
        for robot in self._robots.values():
            robot.receiver.close()
        self._ledger.close()

    def status(self) -> dict[str, Any]:
        """Return for each robot contact, next window, backlog at the last contact, and counters."""
        return {robot: self._status(robot) for robot in self._robots}

    def estimate(self, robot: str, limit: int = MAX_ITEMS) -> dict[str, Any]:
        """Return which products of a robot will be here, and when: ``{robot, known_ns, items, others,
        complete_ns}``.

        ``items`` are products whose records are here; ``others`` are those that the robot reported at the
        last contact only as a number, by priority. A time is null if the plan has too few windows. InputError
        for a robot without windows.
        """
        if robot not in self._robots:
            raise InputError(
                f"robot={robot[:64]!r}: the contact plan has windows of {', '.join(self._robots)}"
            )
        with self._lock:
            waiting = self._waiting(robot)
            others = self._others(robot, waiting)
        now_ns = self._dpm.clock.now_ns()
        order = sorted([*waiting, *others], key=lambda item: item.priority)
        windows = self._plan.after(robot, now_ns)
        arrivals = estimate(order, windows, now_ns, self._exchange.budget_bit_s)
        by_name = {arrival.waiting.name: arrival.arrives_ns for arrival in arrivals}
        times = list(by_name.values())
        return {
            "robot": robot,
            "known_ns": self._ledger.note(f"heard/{robot}"),
            "items": [self._item(item, by_name[item.name]) for item in waiting[:limit]],
            "others": [
                {"priority": o.priority, "what": o.name, "bytes": o.size, "arrives_ns": by_name[o.name]}
                for o in others
            ],
            "complete_ns": None if None in times or not times else max(t for t in times if t is not None),
        }

    def windows(self, robot: str | None = None) -> list[dict[str, Any]]:
        """Return the windows that have not ended, of one robot or of all, in order."""
        now_ns = self._dpm.clock.now_ns()
        windows = [w for w in self._plan.windows if w.end_ns > now_ns and robot in (None, w.robot)]
        return [
            {
                "robot": w.robot,
                "start_ns": w.start_ns,
                "end_ns": w.end_ns,
                "rate_bit_s": w.rate_bit_s,
                "up_bit_s": w.up_rate_bit_s,
                "delay_s": w.delay_s,
                "open": w.start_ns <= now_ns,
            }
            for w in sorted(windows, key=lambda w: w.start)
        ]

    def prioritise(self, robot: str, product_id: str) -> dict[str, Any]:
        """Have a product sent before all others from the next contact on; return its estimate.

        Raises
        ------
        InputError
            For a robot without windows, or a product that is not on its way; or if too many were named.
        """
        self.estimate(robot)  # checks the robot
        with self._lock:
            waiting = {item.name for item in self._waiting(robot)}
            first = [known for known in self._first(robot) if known in waiting]
            if product_id not in waiting:
                raise InputError(
                    f"first={product_id[:64]!r}: no product of {robot} of which only the record is here"
                )
            if product_id not in first:
                first.append(product_id)
            if len(first) > MAX_FIRST:
                raise InputError(f"{MAX_FIRST} products of {robot} are already sent before all others")
            self._ledger.set_note(f"first/{robot}", first)
            self._ledger.prioritise_announced(
                robot,
                [row.ordinal for row in self._ledger.announced(robot) if self._is(robot, row, product_id)],
            )
        (item,) = [item for item in self.estimate(robot)["items"] if item["id"] == product_id]
        return dict(item)

    def _first(self, robot: str) -> list[str]:
        first: list[str] = self._ledger.note(f"first/{robot}", [])
        return first

    def _is(self, robot: str, row: AnnouncedRow, product_id: str) -> bool:
        record = self._robots[robot].arrivals.announced(row.ordinal)
        return record is not None and record.id == product_id

    def _item(self, item: Waiting, arrives_ns: int | None) -> dict[str, Any]:
        return {
            "id": item.name,
            "priority": item.priority,
            "size": item.size,
            "missing": item.missing,
            "arrives_ns": arrives_ns,
        }

    def _waiting(self, robot: str) -> list[Waiting]:
        """Return the products whose records are here and whose payloads are not."""
        state = self._robots[robot]
        waiting = []
        for row in self._ledger.announced(robot):
            record = state.arrivals.announced(row.ordinal)
            if record is not None:
                missing = state.receiver.missing_bytes(Item.PAYLOAD.key(row.ordinal), row.size)
                waiting.append(Waiting(record.id, row.priority, row.size, missing))
        return waiting

    def _others(self, robot: str, waiting: list[Waiting]) -> list[Waiting]:
        """Return the products that the robot has reported only as numbers and bytes, by priority."""
        others = []
        for priority, count, size in self._ledger.note(f"backlog/{robot}", []):
            known = [item for item in waiting if item.priority == priority]
            rest = max(size - sum(item.size for item in known), 0)
            if count > len(known):
                others.append(Waiting(f"{count - len(known)} products", priority, rest, rest))
        return others

    def _status(self, robot: str) -> dict[str, Any]:
        state, now_ns = self._robots[robot], self._dpm.clock.now_ns()
        windows = self._plan.after(robot, now_ns)
        return {
            "contact": self._is_in_contact(state, monotonic_s()),
            "known_ns": self._ledger.note(f"heard/{robot}"),
            "next_window_ns": windows[0].start_ns if windows else None,
            "backlog": self._ledger.note(f"backlog/{robot}", []),
            "bytes_received": state.receiver.bytes_received,
            "bytes_repeated": state.receiver.bytes_repeated,
            **state.arrivals.counters,
        }

    @staticmethod
    def _is_in_contact(state: _Robot, now_s: float) -> bool:
        return now_s - state.receiver.heard_s < _CONTACT_S

    def _wait(self) -> float | None:
        """Wait for the next step; None ends the loop."""
        self._ended.wait(_STEP_S)
        return None if self._ended.is_set() else monotonic_s()

    def _wait_for_flush(self) -> float | None:
        """Wait for the next commit; None ends the loop."""
        self._ended.wait(_FLUSH_S)
        return None if self._ended.is_set() else monotonic_s()

    def _step(self, now_s: float) -> None:
        with self._lock:
            while not self._inbox.empty():
                key, data = self._inbox.get()
                self._receive(key.split("/")[2], data, now_s)
        if now_s >= self._update_s:
            self._update_s = now_s + _UPDATE_S
            self.requests.update()
            for robot in self._robots:
                self._alarms.check_windows(robot, self._ledger.note(f"heard/{robot}"))
        for robot, state in self._robots.items():
            if self._is_in_contact(state, now_s):
                self._send(robot, state, now_s)

    def _flush(self, now_s: float) -> None:
        """Store the received items; on a full disk they wait, and further packets are ignored."""
        try:
            self._changes.scan()
            for state in self._robots.values():
                state.receiver.flush()
        except (StorageError, OSError) as error:
            self._storage_failed(error, now_s)
            return
        errors = [state.arrivals.storage_error for state in self._robots.values()]
        if waiting := next(filter(None, errors), None):
            self._alarms.storage_failed(GROUND, waiting)
        elif now_s >= self._blocked_s:
            self._alarms.storage_works(GROUND)

    def _storage_failed(self, error: Exception, now_s: float) -> None:
        self._blocked_s = now_s + _BLOCKED_S
        self._alarms.storage_failed(GROUND, error)

    def _receive(self, robot: str, data: bytes, now_s: float) -> None:
        state = self._robots.get(robot)
        if state is None:
            logger.warning("a packet of %s, which has no window in the contact plan", robot[:64])
            return
        try:
            kind, fields = unpack(data)
            self._handle(robot, state, kind, fields)
            state.receiver.heard_s = now_s
        except (StorageError, OSError) as error:
            self._storage_failed(error, now_s)
        except (CdffError, ValueError, TypeError, LookupError) as error:
            logger.warning("a packet of %s is not readable: %s", robot, error)

    def _handle(self, robot: str, state: _Robot, kind: Kind, fields: list[Any]) -> None:
        match kind:
            case Kind.HELLO:
                epoch, store_id, backlog = int(fields[0]), str(fields[1]), fields[2]
                backlog = [[int(number) for number in row] for row in backlog]
                if any(len(row) != 3 for row in backlog):
                    raise CodecError(
                        f"backlog {str(backlog)[:80]}: expected rows of priority, count and size"
                    )
                if len(fields) > 3 and (window := self._plan.nearest(robot, self._dpm.clock.now_ns())):
                    self._alarms.compare_clock(robot, int(fields[3]), window.delay_s)
                self._put(robot, state.receiver.welcome(epoch, store_id))
                self._ledger.set_note(f"backlog/{robot}", backlog)
                if len(fields) > 4:
                    self._ledger.set_note(f"{OLDEST}/{robot}", int(fields[4]))
                self._ledger.set_note(f"heard/{robot}", self._dpm.clock.now_ns())
            case Kind.DATA if monotonic_s() >= self._blocked_s and not state.arrivals.is_waiting:
                state.receiver.receive(fields)
            case Kind.TAKEN:
                self.requests.taken(fields[0])
            case Kind.RESULT:
                self.requests.result(fields[0], fields[1])
                self._put(robot, pack(Kind.NOTED, fields[0]))

    def _send(self, robot: str, state: _Robot, now_s: float) -> None:
        window = self._plan.nearest(robot, self._dpm.clock.now_ns())
        if window is None:
            return
        period_s = ack_period_s(window)
        if now_s >= state.times.get("requests", 0.0):
            state.times["requests"] = now_s + _REQUESTS_S
            for row in self.requests.open(robot):
                if now_s >= state.times.get(row.id, 0.0):
                    state.times[row.id] = now_s + 2.0 * window.delay_s + 2.0 * period_s
                    self._put(robot, pack(Kind.REQUEST, row.id, row.body, row.expires_ns))
        if now_s >= state.times.get("first", 0.0):
            state.times["first"] = now_s + _FIRST_S + 2.0 * window.delay_s
            missing = [key for key in self._first(robot) if not self._dpm.store.live([key])]
            if missing:
                self._put(robot, pack(Kind.FIRST, missing))
        if now_s >= state.times.get("acknowledgement", 0.0):
            state.times["acknowledgement"] = now_s + period_s
            with self._lock:
                packet = state.receiver.acknowledgement()
            if packet is not None:
                self._put(robot, packet)

    def _put(self, robot: str, packet: bytes) -> None:
        self._session.send(keys.contact(robot, "up"), packet)
