# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A rover with ROS 2 by rclpy on Fast DDS: test_framework_rovers.py runs it in its environment.

``dds_rover.py REQUEST_RELAY DRIVE.npz`` publishes the sweeps of a drive, then repeats the last one until
pose, frame tree, map, the answer of a service and a DEM have arrived, and prints these as JSON. The program
REQUEST_RELAY offers the service; the DEM is requested by the topics of the gateway.
"""

import array
import json
import subprocess
import sys
import threading
import time

import numpy as np
import rclpy
from dds_dem import DemClient, decode_transforms
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from raw_type import raw_type
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2, PointField

PERIOD_S, SWEEP_NS, LIMIT_S, CALL_S, WAKE_S = 0.5, 100_000_000, 120.0, 20.0, 0.1
FIELDS = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("t", 12, 6)]


def sweep(points, offsets_ns):
    """Return the message of a sweep that began a sweep ago, and its stamp in nanoseconds."""
    records = np.zeros(len(points), [(name, "<f4" if kind == 7 else "<u4") for name, _, kind in FIELDS])
    for i, name in enumerate("xyz"):
        records[name] = points[:, i]
    records["t"] = offsets_ns
    stamp_ns = (time.time_ns() - SWEEP_NS) // 1000 * 1000
    message = PointCloud2(height=1, width=len(points), point_step=16, row_step=16 * len(points))
    message.header.frame_id = "lidar"
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    message.fields = [PointField(name=n, offset=o, datatype=kind, count=1) for n, o, kind in FIELDS]
    message.data = array.array("B", records.tobytes())
    return message, stamp_ns


def pose_of(message):
    """Return stamp in nanoseconds, position and quaternion x y z w."""
    stamp, p, q = message.header.stamp, message.pose.pose.position, message.pose.pose.orientation
    return [stamp.sec * 10**9 + stamp.nanosec, p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def grid_of(grid):
    """Return frame, size and numbers of cells by value."""
    values, counts = np.unique(np.array(grid.data, np.int8), return_counts=True)
    cells = {str(v): int(n) for v, n in zip(values, counts, strict=True)}
    return {"frame_id": grid.header.frame_id, "size": [grid.info.width, grid.info.height], "cells": cells}


def spin(node, stop):
    """Process events until ``stop`` is set, which a wait without a limit would miss."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        executor.spin_once(timeout_sec=WAKE_S)


def main():
    rclpy.init()
    node = rclpy.create_node("rover")
    poses, maps, trees = [], [], []
    latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(PoseWithCovarianceStamped, "/cdff/pose", poses.append, 100)
    node.create_subscription(OccupancyGrid, "/map", maps.append, latched)
    node.create_subscription(raw_type("tf2_msgs", "TFMessage"), "/tf", trees.append, 100, raw=True)
    lidar = node.create_publisher(PointCloud2, "/lidar/points", qos_profile_sensor_data)
    client, dem_client = node.create_client(GetMap, "/cdff/get_map"), DemClient(node, "cdff_gateway")
    stop = threading.Event()
    spinning = threading.Thread(target=spin, args=(node, stop), daemon=True)
    spinning.start()
    drive = np.load(sys.argv[2])
    points, offsets_ns = drive["points"], drive["offsets_ns"]
    starts_ns, requested, dem, end_s = [], None, None, time.monotonic() + LIMIT_S
    while not lidar.get_subscription_count() and time.monotonic() < end_s:
        time.sleep(0.1)
    while time.monotonic() < end_s and (requested is None or dem is None):
        began_s = time.monotonic()
        message, stamp_ns = sweep(points[min(len(starts_ns), len(points) - 1)], offsets_ns)
        starts_ns.append(stamp_ns)
        lidar.publish(message)
        if len(starts_ns) > len(points) + 4 and poses and maps and trees and client.service_is_ready():
            answered = threading.Event()
            future = client.call_async(GetMap.Request())
            future.add_done_callback(lambda _, event=answered: event.set())
            if answered.wait(CALL_S) and future.result().map.data:
                requested = grid_of(future.result().map)
            dem = dem or dem_client.heights(CALL_S)
        time.sleep(max(PERIOD_S - (time.monotonic() - began_s), 0.0))
    edges = [edge for data in list(trees) for edge in decode_transforms(data)]
    result = {
        "starts_ns": starts_ns,
        "poses": [pose_of(message) for message in list(poses)],
        "map": grid_of(maps[-1]) if maps else None,
        "requested": requested,
        "dem": dem,
        "topics": dict(node.get_topic_names_and_types()),
        "tree": [pose for _, _, pose in edges],
        "tree_frames": sorted({(frame, child) for frame, child, _ in edges}),
    }
    print(json.dumps(result), flush=True)
    stop.set()
    spinning.join()
    rclpy.shutdown()


if __name__ == "__main__":
    relay = subprocess.Popen([sys.executable, sys.argv[1], "/cdff/get_map=nav_msgs/srv/GetMap"])
    try:
        main()
    finally:
        relay.terminate()
        relay.wait()
