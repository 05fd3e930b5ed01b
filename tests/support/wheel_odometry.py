# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A driver that publishes wheel odometry while its sensor is on."""

from __future__ import annotations

import threading

import numpy as np

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import TransformWithCovariance


class Driver:
    """Publishes wheel odometry of mana at 50 Hz while the ICU reports that the sensor is on."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.on = threading.Event()
        #: Child frame of the next sample instead of the base.
        self.next_child = ""
        self.modes: list[str] = []
        self.events: list[str] = []
        #: Parameters of the single acquisitions, each of which sends its samples only.
        self.acquired: list[dict[str, float]] = []
        self._stop = threading.Event()
        self._seq = 0
        bus.subscribe(keys.event("mana", "sensor_mode"), self._on_mode)
        bus.subscribe(keys.event("mana", "activated"), lambda _m: self.events.append("activated"))
        bus.subscribe(keys.event("mana", "deactivated"), lambda _m: self.events.append("deactivated"))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _on_mode(self, message: Message) -> None:
        body = unpack(message.payload)
        self.modes.append(body["mode"])
        if body.get("acquires"):
            self.acquired.append(body["parameters"])
            for _ in range(body["acquires"]):
                self.send("mana/base")
            return
        (self.on.set if body["on"] else self.on.clear)()

    def _run(self) -> None:
        while not self._stop.wait(0.02):
            if self.on.is_set():
                self.send(self.next_child or "mana/base")
                self.next_child = ""

    def send(self, child: str) -> None:
        """Publish one sample."""
        self._seq += 1
        stamp_ns = wall_ns()
        matrix = se3.transform(se3.exp_so3([0, 0, 0.5]), [self._seq * 0.01, 0, 0])
        T = UncertainTransform(matrix, np.eye(6) * 1e-4 + 1e-5)
        value = TransformWithCovariance.from_transform(T, parent="site", child=child, stamp_ns=stamp_ns)
        header = Header(
            product_id("mana", "wheels", "odometry", stamp_ns, self._seq, ""),
            self._seq,
            stamp_ns,
            stamp_ns,
            "site",
            "wheels",
            child=child,
        )
        self.bus.publish(
            keys.sensor("mana", "wheels", "odometry"),
            encode(value, "uper"),
            encoding=encoding_string("TransformWithCovariance", "uper"),
            attachment=header.to_attachment(),
        )

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()
