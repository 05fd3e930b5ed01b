# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ordinary work of the mission: sensor samples, products, insertions and requests, recorded by the oracle."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable

import numpy as np

from cdff_common.bus import Bus, Message, keys
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CdffError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import TransformWithCovariance
from tests.chaos.mission import OPERATOR, PLAYER, Mission
from tests.chaos.oracle import Oracle

_POSE = "TransformWithCovariance"
#: Periods of the samples of each robot and of the insertions, seconds.
SAMPLE_S, INSERTION_S = 0.5, 1.0
#: Longest time until an insertion must be accepted; the longest disturbances are shorter.
INSERTED_S = 180.0


class Traffic:
    """Threads with the ordinary work of a mission.

    Parameters
    ----------
    mission : Mission
    oracle : Oracle
    seed : int
    """

    def __init__(self, mission: Mission, oracle: Oracle, seed: int) -> None:
        self._mission, self._oracle, self._seed = mission, oracle, seed
        self._stop = threading.Event()
        self._seq = 0
        operator = mission.bus(OPERATOR)
        for robot in mission.robots:
            operator.subscribe(
                keys.product(robot, "*", "*"),
                lambda message, r=robot: self._on_product(message, r),
                depth=1000,
            )
        work: list[Callable[[], None]] = [self._feed, self._insert]
        work += [lambda number=i: self._ask(number) for i in range(3)]  # type: ignore[misc]
        self._threads = [threading.Thread(target=function, daemon=True) for function in work]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """End the work; open requests and insertions end first."""
        self._stop.set()
        for thread in self._threads:
            thread.join(INSERTED_S)

    def _on_product(self, message: Message, robot: str) -> None:
        self._oracle.publish(Header.from_attachment(message.attachment).id, robot)

    def _feed(self) -> None:
        """Publish samples of the wheels of each robot."""
        bus, number = self._mission.bus(PLAYER), 0
        while not self._stop.wait(SAMPLE_S):
            number += 1
            for robot in self._mission.robots:
                payload, header = _pose(robot, "wheels", number)
                bus.publish(
                    keys.sensor(robot, "wheels", "odometry"),
                    payload,
                    encoding=encoding_string(_POSE, "uper"),
                    attachment=header.to_attachment(),
                )

    def _insert(self) -> None:
        """Insert products as a robot, each until it is acknowledged."""
        bus, number = self._mission.bus("mana"), 0
        while not self._stop.wait(INSERTION_S):
            number += 1
            payload, header = _pose("mana", "writer", number)
            for _ in range(int(INSERTED_S)):
                if self._is_inserted(bus, payload, header):
                    self._oracle.acknowledge(header.id)
                    break
                threading.Event().wait(1.0)
            else:
                self._oracle.violate(f"insertion of {header.id}: not accepted for {INSERTED_S:g} s")

    def _is_inserted(self, bus: Bus, payload: bytes, header: Header) -> bool:
        request = self._oracle.begin_request(f"put {header.id}", 5.0)
        try:
            bus.call(
                keys.dpm_rpc("mana", "put"),
                {"dfpc": "writer", "port": "pose", "product": "pose"},
                payload=payload,
                encoding=encoding_string(_POSE, "uper"),
                attachment=header.to_attachment(),
                timeout_s=5.0,
            )
        except CdffError as error:
            self._end(request, error)
            return False
        self._oracle.end_request(request, "result")
        return True

    def _ask(self, number: int) -> None:
        """Request poses of changing age, robot and deadline."""
        rng = random.Random(f"{self._seed}/requests/{number}")
        client = self._mission.client
        while not self._stop.wait(rng.uniform(0.1, 1.5)):
            robot, deadline_s = rng.choice(self._mission.robots), rng.choice((2.0, 6.0, 15.0))
            max_age_s = rng.choice((0.3, 2.0, 60.0))
            request = self._oracle.begin_request(f"pose of {robot}, {max_age_s:g} s old", deadline_s)
            try:
                client.request("pose", robot=robot, max_age_s=max_age_s, deadline_s=deadline_s)
            except CdffError as error:
                self._end(request, error)
            else:
                self._oracle.end_request(request, "result")

    def _end(self, request: int, error: CdffError) -> None:
        self._oracle.end_request(request, type(error).__name__)
        if str(error).startswith("internal error"):
            self._oracle.violate(f"request ended with {error}, expected a typed error")


def _pose(robot: str, producer: str, number: int) -> tuple[bytes, Header]:
    stamp_ns = wall_ns()
    value = TransformWithCovariance.from_transform(
        UncertainTransform(se3.transform(np.eye(3), [0.01 * number, 0.0, 0.0])),
        parent="site",
        child=f"{robot}/base",
        stamp_ns=stamp_ns,
    )
    header = Header(
        id=product_id(robot, producer, "pose", stamp_ns, number, ""),
        seq=number,
        t0_ns=stamp_ns,
        t1_ns=stamp_ns,
        frame="site",
        child=f"{robot}/base",
        producer=producer,
    )
    return encode(value, "uper"), header
