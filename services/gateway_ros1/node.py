# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A node of ROS 1: publications, subscriptions and services by TCPROS, registered with the master."""

from __future__ import annotations

import ipaddress
import logging
import socket
import threading
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

from cdff_common.errors import CodecError, ConfigurationError, UnavailableError
from services.gateway_ros1.master import RemoteApi
from services.gateway_ros1.publication import Publication
from services.gateway_ros1.service import Ros1Service
from services.gateway_ros1.slave import SlaveApi
from services.gateway_ros1.subscription import Ros1Subscription
from services.gateway_ros1.tcpros import HANDSHAKE_S, Connection
from services.gateways.inputs import DECODER_ERRORS
from services.ros_messages.encoding import Outgoing
from services.ros_messages.md5_sums import message_md5, service_md5, wire_name
from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ServiceType

logger = logging.getLogger(__name__)

#: Interval of the checks of the master, seconds, and largest number of connections from other nodes.
_CHECK_S, _MAX_CONNECTIONS = 1.0, 64
#: Pause after a connection that the system could not accept, seconds.
_PAUSE_S = 0.1
_ANY_MD5 = "*"


class Ros1Node:
    """A node of ROS 1.

    Parameters
    ----------
    master_uri : str
    host : str
        Address on which it listens, and by which the robot reaches it.
    name : str
        Such as ``/cdff_gateway``.
    types : RosTypes

    Attributes
    ----------
    master_faults : int
        Number of failed checks of the master, or registrations with it.
    last_master_fault : str

    Raises
    ------
    ConfigurationError
        If ``host`` is not one address of this machine.
    """

    def __init__(self, master_uri: str, host: str, name: str, types: RosTypes) -> None:
        self.master_uri, self.name, self.types = master_uri, name, types
        self.master = RemoteApi(master_uri, name)
        self.is_registered = False
        self.master_faults, self.last_master_fault = 0, ""
        self._lock = threading.Lock()
        self._publications: dict[str, Publication] = {}
        self._subscriptions: dict[str, Ros1Subscription] = {}
        self._services: dict[str, Ros1Service] = {}
        self._watched: dict[str, Callable[[Any], None]] = {}
        self._open: set[Connection] = set()
        self._master_pid: object = None
        self._stop = threading.Event()
        self._listener = _listen(host, master_uri)
        self._host, self._port = host, int(self._listener.getsockname()[1])
        self._slave = SlaveApi(self, host)
        self._threads = [
            threading.Thread(target=work, name=title, daemon=True)
            for work, title in ((self._accept, "tcpros"), (self._watch_master, "master"))
        ]

    def start(self) -> None:
        """Register with the master as soon as it answers, and again after each of its restarts."""
        for thread in self._threads:
            thread.start()

    def problem(self) -> str:
        """Return which thread of a node that is started and not closed has ended, or an empty text."""
        is_running = not self._stop.is_set()
        threads = [*self._threads, self._slave.thread]
        with self._lock:
            subscriptions = list(self._subscriptions.values())
        threads += [thread for subscription in subscriptions for thread in subscription.threads()]
        ended = [t.name for t in threads if is_running and t.ident and not t.is_alive()]
        return f"the thread {ended[0]!r} of the node {self.name} has ended" if ended else ""

    def close(self) -> None:
        """Withdraw from the master and close all connections."""
        self._stop.set()
        with suppress(UnavailableError):
            self._unregister()
        self._listener.close()
        self._slave.close()
        for subscription in self._subscriptions.values():
            subscription.close()
        for publication in self._publications.values():
            publication.close()
        with self._lock:
            connections = list(self._open)
        for connection in connections:
            connection.close()

    def publish(self, out: Outgoing, *, latched: bool) -> None:
        """Publish a message."""
        self.declare_publisher(out.topic, out.type_name, latched=latched)
        self._publications[out.topic].publish(bytes(self.types.serialize(out.message, out.type_name)))

    def declare_publisher(self, topic: str, type_name: str, *, latched: bool) -> None:
        """Announce a topic, unless it is announced."""
        with self._lock:
            if topic in self._publications:
                return
            text, md5 = self.types.store.generate_msgdef(type_name)
            publication = Publication(topic, wire_name(type_name), md5, text, latched=latched)
            self._publications[topic] = publication
        if self.is_registered:
            with suppress(UnavailableError):  # the thread of the master registers it again
                self.master.call("registerPublisher", topic, publication.type_name, self._slave.uri)

    def subscribe(
        self,
        topic: str,
        type_name: str,
        callback: Callable[[bytes], None],
        on_fault: Callable[[str, str], None],
        *,
        max_bytes: int,
    ) -> None:
        """Subscribe to a topic: ``callback`` receives messages, ``on_fault`` reason and detail of a fault."""
        subscription = Ros1Subscription(
            self.name,
            topic,
            wire_name(type_name),
            message_md5(self.types, type_name),
            callback,
            on_fault,
            max_bytes=max_bytes,
        )
        self._subscriptions[topic] = subscription

    def serve(self, name: str, service: ServiceType, handler: Callable[[Any], Any]) -> None:
        """Answer a service with ``handler``, from request to response."""

        def handle(data: bytes) -> bytes:
            try:
                request = self.types.deserialize(data, service.request)
            except DECODER_ERRORS as error:
                raise CodecError(f"{len(data)} bytes of {service.name}: {error}") from error
            return bytes(self.types.serialize(handler(request), service.response))

        md5 = service_md5(self.types, service.request, service.response)
        self._services[name] = Ros1Service(name, wire_name(service.name), md5, handle)

    def watch_parameter(self, key: str, callback: Callable[[Any], None]) -> None:
        """Call ``callback`` with each value that the parameter server states."""
        self._watched[key] = callback

    def publications(self) -> list[list[str]]:
        """Return topics and types."""
        with self._lock:
            return [[p.topic, p.type_name] for p in self._publications.values()]

    def subscriptions(self) -> list[list[str]]:
        """Return topics and types."""
        return [[s.topic, s.type_name] for s in self._subscriptions.values()]

    def dropped(self, topic: str, others: Collection[str] = ()) -> int:
        """Return the number of messages of a topic that slow subscribers missed.

        Topics below it, such as those of images, count too, but for those at or below one of ``others``.
        """
        with self._lock:
            publications = list(self._publications.values())
        inner = [other for other in others if _is_below(other, topic) and other != topic]
        return sum(
            p.dropped
            for p in publications
            if _is_below(p.topic, topic) and not any(_is_below(p.topic, other) for other in inner)
        )

    def connections(self) -> list[list[Any]]:
        """Return the connections as ``rosnode info`` shows them."""
        rows = [["i", s.topic, peer] for s in self._subscriptions.values() for peer in s.peers()]
        with self._lock:
            rows += [["o", p.topic, peer] for p in self._publications.values() for peer in p.peers()]
        return [[i, peer, way, "TCPROS", topic, True] for i, (way, topic, peer) in enumerate(rows)]

    def update_publishers(self, topic: str, uris: list[str]) -> None:
        """Take the publishers of a topic."""
        if topic in self._subscriptions:
            # What this node publishes on a topic in both directions would circulate.
            self._subscriptions[topic].update([uri for uri in uris if uri != self._slave.uri])

    def update_parameter(self, key: str, value: Any) -> None:
        """Take the value of a parameter."""
        callback = self._watched.get(key.rstrip("/"))
        if callback is not None:
            callback(value)

    def has_topic(self, topic: str) -> bool:
        """Return True if the node publishes a topic."""
        return topic in self._publications

    def address(self) -> tuple[str, int]:
        """Return host and port of the connections."""
        return self._host, self._port

    def _watch_master(self) -> None:
        while not self._stop.is_set():
            try:
                pid = self.master.call("getPid")
                if not self.is_registered or pid != self._master_pid:
                    self._register()
                    self._master_pid, self.is_registered = pid, True
                    logger.info("registered with the master at %s", self.master_uri)
            except UnavailableError as error:
                fault = str(error)
                if self.is_registered or fault != self.last_master_fault:
                    logger.warning("not registered with the master: %s", error)
                self.master_faults, self.last_master_fault = self.master_faults + 1, fault
                self.is_registered = False
            self._stop.wait(_CHECK_S)

    def _register(self) -> None:
        call, uri = self.master.call, self._slave.uri
        with self._lock:
            publications = list(self._publications.values())
        for publication in publications:
            call("registerPublisher", publication.topic, publication.type_name, uri)
        for subscription in self._subscriptions.values():
            uris = call("registerSubscriber", subscription.topic, subscription.type_name, uri)
            if not isinstance(uris, list):
                raise UnavailableError(
                    f"{self.master_uri}: registerSubscriber of {subscription.topic}: "
                    f"{str(uris)[:80]!r}, expected a list of publishers"
                )
            self.update_publishers(subscription.topic, [str(u) for u in uris])
        for name in self._services:
            call("registerService", name, f"rosrpc://{self._host}:{self._port}", uri)
        for key, callback in self._watched.items():
            value = call("subscribeParam", uri, key)
            if value != {}:  # as the master states a parameter that is not set
                callback(value)

    def _unregister(self) -> None:
        call, uri = self.master.call, self._slave.uri
        for topic in self._publications:
            call("unregisterPublisher", topic, uri)
        for topic in self._subscriptions:
            call("unregisterSubscriber", topic, uri)
        for name in self._services:
            call("unregisterService", name, f"rosrpc://{self._host}:{self._port}")

    def _accept(self) -> None:
        while not self._stop.is_set():
            try:
                sock, address = self._listener.accept()
            except OSError as error:
                if not self._stop.wait(_PAUSE_S):
                    logger.warning("a connection is not accepted: %s", error)
                continue
            with self._lock:
                is_full = len(self._open) >= _MAX_CONNECTIONS
                connection = Connection(sock)
                if not is_full:
                    self._open.add(connection)
            if is_full:
                logger.warning("a connection of %s is refused: %d are open", address, _MAX_CONNECTIONS)
                connection.close()
                continue
            thread = threading.Thread(target=self._serve, args=(connection,), name="tcpros", daemon=True)
            try:
                thread.start()
            except RuntimeError as error:  # the process has too many threads
                logger.warning("a connection of %s is refused: %s", address, error)
                with self._lock:
                    self._open.discard(connection)
                connection.close()

    def _serve(self, connection: Connection) -> None:
        """Answer the header of a node that has connected, and then its requests, or send it messages."""
        try:
            connection.wait(HANDSHAKE_S)
            asked = connection.receive_header()
            server: Publication | Ros1Service | None
            server = self._publications.get(asked.get("topic", ""))
            server = server or self._services.get(asked.get("service", ""))
            problem = _problem(asked, server)
            if problem or server is None:
                logger.warning("%s is refused: %s", asked.get("callerid", "a node"), problem)
                connection.send_header({"error": problem})
                return
            connection.send_header({"callerid": self.name, **server.header()})
            connection.wait(None)
            server.serve(connection, asked)
        except CodecError as error:
            logger.warning("a connection is closed: %s", error)
        except (OSError, EOFError) as error:
            logger.debug("a connection ends: %s", error)
        finally:
            connection.close()
            with self._lock:
                self._open.discard(connection)


def _is_below(topic: str, parent: str) -> bool:
    """Return whether a topic is another one, or below it."""
    return f"{topic}/".startswith(f"{parent}/")


def _listen(host: str, master_uri: str) -> socket.socket:
    """Return a listening socket at an address of this machine; refuse all interfaces, which is no address."""
    try:
        addresses = socket.getaddrinfo(host or "0.0.0.0", None, socket.AF_INET, socket.SOCK_STREAM)
        address = str(addresses[0][4][0])
        if ipaddress.ip_address(address).is_unspecified:
            raise ConfigurationError(
                f"host {host!r}: expected one address of this machine, by which the robot reaches it, "
                "in --host or ROS_IP; other nodes connect to this address"
            )
        _check_reachable(address, master_uri)
        return socket.create_server((address, 0))
    except (OSError, UnicodeError) as error:
        raise ConfigurationError(
            f"host {host!r}: {error}; expected a name or an IPv4 address of this machine in --host or ROS_IP"
        ) from error


def _check_reachable(address: str, master_uri: str) -> None:
    """Raise ConfigurationError for an address of this machine only if the master is on another machine."""
    try:
        master = socket.gethostbyname(urlsplit(master_uri).hostname or "")
    except OSError:  # the name may become known later
        return
    if ipaddress.ip_address(address).is_loopback and not ipaddress.ip_address(master).is_loopback:
        raise ConfigurationError(
            f"host {address}: the master is at {master}, and its nodes cannot reach this address; state the "
            "address of this machine in --host or ROS_IP"
        )


def _problem(asked: dict[str, str], server: Publication | Ros1Service | None) -> str:
    """Return why a node that has connected is refused, or an empty text."""
    if server is None:
        return f"no topic or service {asked.get('topic') or asked.get('service') or ''!r} here"
    if asked.get("md5sum", "") not in (_ANY_MD5, server.md5):
        return f"md5sum {asked.get('md5sum', '')!r} of {server.type_name}: expected {server.md5}"
    if isinstance(server, Publication) and asked.get("type", _ANY_MD5) not in (_ANY_MD5, server.type_name):
        return f"type {asked['type']!r}: expected {server.type_name}"
    return ""
