# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A rover with ROS 1 by Debian's rospy, in its Python: test_framework_rovers.py runs it.

``ros1_rover.py GRID_MAP_TYPES DRIVE.npz`` publishes the sweeps of a drive, then repeats the last one until
pose, frame tree, map and the DEM of a service have arrived, and prints these as JSON.
``GRID_MAP_TYPES`` is the folder of ``ros1_peer.py``, which has the types that Debian does not have.
"""

import json
import math
import sys
import threading
import time

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

sys.path.insert(0, sys.argv[1])
from ros1_peer import GetGridMap

PERIOD_S, SWEEP_S, LIMIT_S = 0.5, 0.1, 120.0
FIELDS = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("t", 12, 6)]


def sweep(points, offsets_ns):
    """Return the message of a sweep that began a sweep ago."""
    records = np.zeros(len(points), [(name, "<f4" if kind == 7 else "<u4") for name, _, kind in FIELDS])
    for i, name in enumerate("xyz"):
        records[name] = points[:, i]
    records["t"] = offsets_ns
    stamp_us = int(1e6 * (time.time() - SWEEP_S))
    stamp = rospy.Time(stamp_us // 10**6, stamp_us % 10**6 * 1000)
    return PointCloud2(
        header=Header(stamp=stamp, frame_id="lidar"),
        height=1,
        width=len(points),
        fields=[PointField(name, offset, kind, 1) for name, offset, kind in FIELDS],
        point_step=16,
        row_step=16 * len(points),
        data=records.tobytes(),
    )


def heights(client):
    """Return the DEM of the service, or None if it has no cells."""
    answer = client(
        frame_id="map", position_x=2.0, position_y=0.0, length_x=4.0, length_y=4.0, layers=["mean"]
    )
    if not answer.map.data or not answer.map.data[0].data:
        return None
    info = answer.map.info
    return {
        "frame_id": info.header.frame_id,
        "resolution": info.resolution,
        "lengths": [info.length_x, info.length_y],
        "position": [info.pose.position.x, info.pose.position.y],
        "values": [v if math.isfinite(v) else None for v in answer.map.data[0].data],
    }


def pose_of(stamp, position, q):
    """Return stamp in nanoseconds, position and quaternion x y z w."""
    return [stamp.to_nsec(), position.x, position.y, position.z, q.x, q.y, q.z, q.w]


def main():
    rospy.init_node("rover", disable_signals=True)
    lock, poses, edges, maps = threading.Lock(), [], [], []

    def take(messages):
        def on_message(message):
            with lock:
                messages.append(message)

        return on_message

    rospy.Subscriber("/cdff/pose", PoseWithCovarianceStamped, take(poses))
    rospy.Subscriber("/tf", TFMessage, take(edges))
    rospy.Subscriber("/map", OccupancyGrid, take(maps))
    lidar = rospy.Publisher("/lidar/points", PointCloud2, queue_size=10)
    rospy.wait_for_service("/cdff/get_dem", 60)
    client = rospy.ServiceProxy("/cdff/get_dem", GetGridMap)
    end_s = time.monotonic() + LIMIT_S
    while not lidar.get_num_connections() and time.monotonic() < end_s:
        time.sleep(0.1)
    drive = np.load(sys.argv[2])
    points, offsets_ns = drive["points"], drive["offsets_ns"]
    starts_ns, dem = [], None
    while time.monotonic() < end_s and dem is None:
        began_s = time.monotonic()
        message = sweep(points[min(len(starts_ns), len(points) - 1)], offsets_ns)
        starts_ns.append(message.header.stamp.to_nsec())
        lidar.publish(message)
        if len(starts_ns) > len(points) + 4 and poses and edges and maps:
            dem = heights(client)
        time.sleep(max(PERIOD_S - (time.monotonic() - began_s), 0.0))
    with lock:
        transforms = [t for message in edges for t in message.transforms]
        grid = maps[-1] if maps else None
        values, counts = np.unique(np.array(grid.data if grid else [], np.int8), return_counts=True)
        result = {
            "starts_ns": starts_ns,
            "poses": [pose_of(m.header.stamp, m.pose.pose.position, m.pose.pose.orientation) for m in poses],
            "pose_frames": sorted({m.header.frame_id for m in poses}),
            "tree": [
                pose_of(t.header.stamp, t.transform.translation, t.transform.rotation) for t in transforms
            ],
            "tree_frames": sorted({(t.header.frame_id, t.child_frame_id) for t in transforms}),
            "map": grid
            and {
                "frame_id": grid.header.frame_id,
                "size": [grid.info.width, grid.info.height],
                "cells": {str(v): int(n) for v, n in zip(values, counts, strict=True)},
            },
            "dem": dem,
        }
    print(json.dumps(result), flush=True)
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main()
