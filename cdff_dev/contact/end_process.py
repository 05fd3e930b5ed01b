# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``python -m cdff_dev.contact.end_process SIDE FOLDER PLAN ENDPOINT``: a store and one end of the exchange.

The process answers commands, each one line of JSON on the standard input, by one line on the standard output.
It has no router and no HTTP server, so that an evaluation can start and kill it often.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from cdff_common.errors import CdffError
from cdff_common.interfaces.contact_plan import load_contact_plan
from cdff_common.interfaces.profile import Exchange
from cdff_common.mission_clock import MissionClock
from cdff_dev.contact.generated_products import ROBOT, product
from dpm_store import open_store
from dpm_store.exchange.ledger import Ledger
from services.contact.ground_end import GroundEnd
from services.contact.packets import INLINE_BYTES, pack_record
from services.contact.robot_end import RobotEnd
from services.dpm.operations.dpm import Dpm


class OffsetClock(MissionClock):
    """A mission clock that differs from the wall clock.

    Parameters
    ----------
    offset_s : float
        Clock minus the wall clock, seconds.
    """

    def __init__(self, offset_s: float) -> None:
        super().__init__()
        self._offset_ns = int(offset_s * 1e9)

    def now_ns(self) -> int:
        """Return the mission time."""
        return super().now_ns() + self._offset_ns


class Commands:
    """Commands of the process; each method with a public name is one.

    Parameters
    ----------
    dpm : Dpm
    open_end : callable
        Starts the exchange.
    """

    def __init__(self, dpm: Dpm, open_end: Callable[[], RobotEnd | GroundEnd]) -> None:
        self._dpm, self._open_end = dpm, open_end
        self._end: RobotEnd | GroundEnd | None = None

    def begin(self) -> None:
        """Read the contact plan and start the exchange."""
        self._end = self._open_end()

    def put(self, seed: int, numbers: list[int]) -> list[str]:
        """Store generated products; return their ids: from then on they must not be lost."""
        products = [product(seed, number) for number in numbers]
        self._dpm.store.put_all(products)
        return [p.header.id for p in products]

    def digests(self) -> dict[str, str]:
        """Return the SHA-256 of the payload of each product by its id."""
        store = self._dpm.store
        return {key: hashlib.sha256(store.payload(key)).hexdigest() for key in self._inserted()}

    def insertions(self) -> int:
        """Return how many insertions the history has: more than products if one was stored twice."""
        return len(self._inserted())

    def types(self) -> list[str]:
        """Return the types of the products in the order of their insertion."""
        return [self._dpm.store.get(key).product for key in self._inserted()]

    def has(self, product_id: str) -> bool:
        """Return whether a product is in the store."""
        return bool(self._dpm.store.live([product_id]))

    def alarm(self, label: str) -> int:
        """Append the event of an alarm, and return its time."""
        self._dpm.store.events.append(ROBOT, "alarm", {"alarm": label, "active": True})
        return self._dpm.clock.now_ns()

    def has_alarm_of_robot(self, label: str) -> bool:
        """Return whether an alarm of the robot is in the history."""
        return label in [
            str(e.body["alarm"]) for e in self._dpm.store.events.since(kind="alarm", scope=ROBOT)
        ]

    def alarms(self) -> list[str]:
        """Return the kinds of the active alarms of this process."""
        return [alarm.kind for alarm in self._dpm.alarms.active()]

    def status(self) -> dict[str, Any]:
        """Return the state of the exchange."""
        assert self._end is not None
        status = self._end.status()
        return status if isinstance(self._end, RobotEnd) else dict(status[ROBOT])

    def estimate(self) -> dict[str, Any]:
        """Return the arrivals that the ground expects."""
        assert isinstance(self._end, GroundEnd)
        return self._end.estimate(ROBOT)

    def request(self, request_id: str, parameters: dict[str, str], expires_s: float) -> dict[str, Any]:
        """Keep a request at the ground."""
        assert isinstance(self._end, GroundEnd)
        return self._end.requests.add(ROBOT, parameters, expires_s, request_id)

    def requests(self) -> list[dict[str, Any]]:
        """Return id, state and time of the requests in the ledger."""
        with closing(Ledger(self._dpm.store.directory)) as ledger:
            return [{"id": r.id, "state": r.state, "made_ns": r.made_ns} for r in ledger.requests()]

    def item_bytes(self) -> int:
        """Return the bytes of the records and payloads of all products, each once."""
        store, total = self._dpm.store, 0
        for key in self._inserted():
            record = store.get(key)
            is_small = record.size <= INLINE_BYTES
            total += len(pack_record(record, 0, store.payload(key) if is_small else None))
            total += 0 if is_small else record.size
        return total

    def received_bytes(self) -> int:
        """Return the bytes of records and payloads that the ground has noted, complete or in part."""
        with closing(Ledger(self._dpm.store.directory)) as ledger:
            parts = sum(end - first for part in ledger.parts(ROBOT) for first, end in part.ranges)
            records = sum(len(row.body) for row in ledger.announced(ROBOT))
        return parts + records + self.item_bytes()

    def close(self) -> None:
        """End the exchange."""
        if self._end is not None:
            self._end.close()

    def _inserted(self) -> list[str]:
        ids, last = [], 0
        while events := self._dpm.store.events.since(last, limit=1000):
            last = events[-1].ordinal
            ids += [str(event.body["id"]) for event in events if event.kind == "inserted"]
        return ids


def main(arguments: list[str] | None = None) -> int:
    """Answer commands until the standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("side", choices=["robot", "ground"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("plan", type=Path)
    parser.add_argument("endpoint")
    parser.add_argument("--clock-offset-s", type=float, default=0.0)
    parser.add_argument("--budget-bit-s", type=float)
    args = parser.parse_args(arguments)
    exchange = Exchange(budget_bit_s=args.budget_bit_s)

    def open_end() -> RobotEnd | GroundEnd:
        plan = load_contact_plan(args.plan)
        if args.side == "ground":
            return GroundEnd(dpm, plan, args.endpoint, exchange)
        return RobotEnd(ROBOT, dpm, plan, args.endpoint, exchange, _execute)

    with closing(open_store(f"sqlite:///{args.folder}", OffsetClock(args.clock_offset_s))) as store:
        dpm = Dpm(store)
        with closing(Commands(dpm, open_end)) as commands:
            _answer(commands)
    return 0


def _answer(commands: Commands) -> None:
    answers = _take_output()
    answers({"ready": True})
    for line in sys.stdin:
        name, arguments = json.loads(line)
        try:
            answer = {"result": getattr(commands, name)(**arguments)}
        except CdffError as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers(answer)


def _take_output() -> Callable[[dict[str, Any]], None]:
    """Return a function that writes answers to the standard output.

    What libraries write to the standard output, such as the warnings of Zenoh, goes to the standard error.
    """
    file = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def write(answer: dict[str, Any]) -> None:
        file.write(json.dumps(answer) + "\n")
        file.flush()

    return write


def _execute(parameters: dict[str, str], _: float) -> dict[str, Any]:
    """Answer a request with the first generated product."""
    return {"id": product(1, 0).header.id}


if __name__ == "__main__":
    sys.exit(main())
