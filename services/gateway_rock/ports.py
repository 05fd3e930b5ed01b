# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ports of tasks that become sensor streams, and products that are written to ports of tasks."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections import deque
from contextlib import suppress
from typing import Any

from cdff_common.bus import Bus
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, CodecError, InputError, UnavailableError
from cdff_common.interfaces.product import Header
from services.corba.naming import NameService
from services.corba.typecodes import TypeCode
from services.gateway_rock.settings import InputPort, OutputPort
from services.gateway_rock.tasks import PortReader, PortWriter, Task
from services.gateways.frames import FrameNames
from services.gateways.product_link import ProductLink
from services.gateways.sample_link import CONVERSION_ERRORS, SampleLink
from services.rock_types.conversions import CONVERSIONS, conversion_of
from services.rock_types.encoders import encoded
from services.rock_types.values import Source, names_of, stamp_ns

logger = logging.getLogger(__name__)

#: Time before another attempt to connect, doubled with each up to the second value, seconds.
_RETRY_S, _MAX_RETRY_S = 0.5, 10.0
#: Products that wait for a task; with more the oldest is dropped.
_MAX_WAITING = 16
#: Time in which a sample that states a type is expected, seconds.
_TYPE_POLL_S = 0.2


class _Worker(ABC):
    """Thread that connects to a task, and connects again when the connection has ended."""

    def __init__(self, title: str) -> None:
        self.is_connected, self.last_error = False, ""
        self._title, self._stop = title, threading.Event()
        self.thread = threading.Thread(target=self._run, name=title, daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self.thread.start()

    def stop(self) -> None:
        """Ask the thread to end."""
        self._stop.set()

    def connection(self) -> dict[str, Any]:
        """Return the state of the connection as plain data."""
        return {"connected": self.is_connected, "last_error": self.last_error}

    def _run(self) -> None:
        retry_s = _RETRY_S
        while not self._stop.is_set():
            try:
                self._work()
            except CdffError as error:
                is_new = self.is_connected or str(error) != self.last_error
                if is_new and not self._stop.is_set():
                    logger.warning("%s: %s", self._title, error)
                retry_s = _RETRY_S if self.is_connected else min(2.0 * retry_s, _MAX_RETRY_S)
                self.is_connected, self.last_error = False, str(error)[:300]
            self._stop.wait(retry_s)
        self.is_connected = False

    @abstractmethod
    def _work(self) -> None:
        """Connect, and transfer samples until the gateway ends; raises CdffError if the connection ends."""


class RockInput(_Worker):
    """An output port of a task and the sensor stream that it becomes.

    Parameters
    ----------
    entry : InputPort
    names : FrameNames
    services : NameService
    bus : Bus
        Bus of the samples.
    """

    def __init__(self, entry: InputPort, names: FrameNames, services: NameService, bus: Bus) -> None:
        title = f"{entry.task}.{entry.port}"
        super().__init__(title)
        self.entry, self._names, self._services = entry, names, services
        self.link = SampleLink(entry, title, CONVERSIONS[entry.type][0].type_name, names.robot, bus)

    def _work(self) -> None:
        task = Task(self._services, self.entry.task)
        _check_type(task, self.entry.port, self.entry.type, is_output=True)
        reader = task.reader(self.entry.port, self.entry.queue)
        self.is_connected, self.last_error = True, ""
        try:
            self._poll(reader)
        finally:
            with suppress(CdffError):  # the task has ended
                reader.close()

    def _poll(self, reader: PortReader) -> None:
        while not self._stop.is_set():
            try:
                found = reader.read()
            except CodecError as error:
                self.link.drop("decoding", str(error))
                raise
            if found is None:
                self._stop.wait(1.0 / self.entry.poll_hz)
            else:
                self.on_value(found[1], found[2])

    def on_value(self, value: Any, size: int) -> None:
        """Convert a value and send it as a sample; a faulty value is counted and dropped."""
        start_s = monotonic_s()
        if not self.link.admits(size, start_s):
            return
        try:
            names = names_of(value) if isinstance(value, dict) else ()
            conversion = conversion_of(self.entry.type, names)
            time_ns = stamp_ns(value["time"])
            if time_ns is None or time_ns <= 0:
                raise InputError("stamp 0: expected a time of capture since 1970")
            source = Source(
                self.entry.task,
                time_ns,
                robot=self._names.robot,
                frames=self._names.frames,
                sensor=self.entry.frame,
            )
            sample, frame, child = conversion.convert(value, source)
            self.link.send(sample, (frame, child), time_ns, start_s)
        except (CdffError, *CONVERSION_ERRORS) as error:
            self.link.drop("content", f"{type(error).__name__}: {error}")


class RockOutput(_Worker, ProductLink):
    """A product and the input port of a task that receives it.

    Parameters
    ----------
    entry : OutputPort
    names : FrameNames
    services : NameService
    """

    def __init__(self, entry: OutputPort, names: FrameNames, services: NameService) -> None:
        _Worker.__init__(self, f"{entry.task}.{entry.port}")
        ProductLink.__init__(self, entry)
        self.entry, self._names, self._services = entry, names, services
        self._waiting: deque[dict[str, Any]] = deque()
        self._changed = threading.Condition()

    def send(self, value: Any, header: Header) -> None:
        """Add a value to those that wait for the task; of too many the oldest is dropped."""
        value = encoded(value, self.entry.type, self._names.of_robot, header.t1_ns)
        with self._changed:
            if len(self._waiting) >= _MAX_WAITING:
                self._waiting.popleft()
                self.drop("queue", f"{_MAX_WAITING} products wait for {self.entry.task}")
            self._waiting.append(value)
            self._changed.notify()

    def stop(self) -> None:
        """Ask the thread to end."""
        super().stop()
        with self._changed:
            self._changed.notify()

    def _work(self) -> None:
        kind = self._type()
        task = Task(self._services, self.entry.task)
        _check_type(task, self.entry.port, self.entry.type, is_output=False)
        writer = task.writer(self.entry.port)
        self.is_connected, self.last_error = True, ""
        try:
            while not self._stop.is_set():
                self._write_next(writer, kind)
        finally:
            with suppress(CdffError):  # the task has ended
                writer.close()

    def _type(self) -> TypeCode:
        """Return the type of the port as the robot names it, from a sample of another port."""
        task_name, _, port = self.entry.type_of.rpartition(".")
        task = Task(self._services, task_name)
        _check_type(task, port, self.entry.type, is_output=True)
        reader = task.reader(port, 1)
        self.last_error = f"no sample of {self.entry.type_of} yet, whose type is needed"
        try:
            while not self._stop.is_set():
                found = reader.read()
                if found is not None:
                    return found[0]
                self._stop.wait(_TYPE_POLL_S)
        finally:
            with suppress(CdffError):
                reader.close()
        raise UnavailableError("the gateway ends")

    def _write_next(self, writer: PortWriter, kind: TypeCode) -> None:
        with self._changed:
            while not self._waiting and not self._stop.is_set():
                self._changed.wait()
            if not self._waiting:
                return
            value = self._waiting.popleft()
        try:
            writer.write(kind, value)
        except (CodecError, InputError) as error:
            self.drop("content", f"{type(error).__name__}: {error}")
        except UnavailableError as error:
            self.drop("connection", str(error))
            raise


def _check_type(task: Task, port: str, type_name: str, *, is_output: bool) -> None:
    """Raise InputError if a port does not exist, or has another direction or type."""
    found = task.port(port, is_output=is_output)
    if found.type_name.removesuffix("_m") != type_name.removesuffix("_m"):
        raise InputError(f"{task.name}.{port}: type {found.type_name}, expected {type_name}")
