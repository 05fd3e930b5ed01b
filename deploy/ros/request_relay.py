#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Offer the services of cdff's gateway on DDS in ROS 2, and relay their requests on two topics.

    python3 request_relay.py [--node cdff_gateway] [--timeout 30] /cdff/get_map=nav_msgs/srv/GetMap ...

It runs with the ROS 2 of the robot (rclpy, the packages of the service types) and needs no package of cdff.
Without an answer in time a request fails: the caller gets an empty response, and the log names the service.
"""

import argparse
import array
import contextlib
import importlib
import threading
import uuid

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import UInt8MultiArray

#: Bytes of the identifier of a request, and of the length of the name behind it.
ID_BYTES, LENGTH_BYTES = 16, 2
#: Longest wait for an event in seconds. The executor can miss that a thread has finished a callback, or that
#: a signal arrived; without this limit it would then wait for ever.
WAKE_S = 0.1


def service_type(name):
    """Return the class of a type such as nav_msgs/srv/GetMap."""
    package, _, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.srv"), kind)


class Relay:
    """Services of a node and the two topics of the gateway."""

    def __init__(self, node, gateway, services, timeout_s):
        self._node, self._timeout_s = node, timeout_s
        self._lock, self._waiting = threading.Lock(), {}
        group = ReentrantCallbackGroup()
        self._requests = node.create_publisher(UInt8MultiArray, f"/{gateway}/requests", 16)
        node.create_subscription(
            UInt8MultiArray, f"/{gateway}/responses", self._on_response, 16, callback_group=group
        )
        for name, type_name in services:
            kind = service_type(type_name)
            node.create_service(kind, name, self._handler(name, kind), callback_group=group)

    def _handler(self, name, kind):
        encoded = name.encode()

        def handle(request, response):
            identifier, arrived = uuid.uuid4().bytes, threading.Event()
            with self._lock:
                self._waiting[identifier] = [arrived, b""]
            head = identifier + len(encoded).to_bytes(LENGTH_BYTES, "little") + encoded
            self._requests.publish(UInt8MultiArray(data=array.array("B", head + serialize_message(request))))
            is_answered = arrived.wait(self._timeout_s)
            with self._lock:
                content = self._waiting.pop(identifier)[1]
            if not is_answered:
                self._node.get_logger().error(f"{name}: no answer of the gateway in {self._timeout_s:g} s")
                return response
            return deserialize_message(content, kind.Response)

        return handle

    def _on_response(self, message):
        data = message.data.tobytes()
        length = int.from_bytes(data[ID_BYTES : ID_BYTES + LENGTH_BYTES], "little")
        with self._lock:
            entry = self._waiting.get(data[:ID_BYTES])
            if entry is not None:
                entry[1] = data[ID_BYTES + LENGTH_BYTES + length :]
                entry[0].set()


def main():
    """Relay until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--node", default="cdff_gateway", help="name of the gateway's node in its settings")
    parser.add_argument("--timeout", type=float, default=30.0, help="time of a request in seconds")
    parser.add_argument(
        "services", nargs="+", metavar="NAME=TYPE", help="such as /cdff/get_map=nav_msgs/srv/GetMap"
    )
    args = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node(f"{args.node}_relay")
    Relay(node, args.node, [entry.split("=", 1) for entry in args.services], args.timeout)
    executor = MultiThreadedExecutor(8)
    executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        while rclpy.ok():
            executor.spin_once(timeout_sec=WAKE_S)


if __name__ == "__main__":
    main()
