# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robot with rclpy on Fast DDS (``make peers``: build/dds-peers), for the test of the gateway on DDS.

python dds_peer.py SECONDS POINTS

Publishes an IMU, a cloud of POINTS points and an odometry, and messages that the gateway must refuse; writes
the numbers of received messages as JSON when it has three poses and a map, at the latest after SECONDS.
"""

import array
import json
import struct
import sys
import time

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Imu, PointCloud2, PointField
from std_msgs.msg import String

limit_s, number = float(sys.argv[1]), int(sys.argv[2])
rclpy.init()
node = rclpy.create_node("robot")
poses, maps = [], []
latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(PoseWithCovarianceStamped, "/cdff/pose", poses.append, 10)
node.create_subscription(OccupancyGrid, "/map", maps.append, latched)
imus = node.create_publisher(Imu, "/imu/data", qos_profile_sensor_data)
clouds = node.create_publisher(PointCloud2, "/lidar/points", 10)
odometries = node.create_publisher(Odometry, "/odom", 10)
# Incompatible with the gateway: best effort for a reliable subscription, and another type.
node.create_publisher(Odometry, "/odom", qos_profile_sensor_data)
context = rclpy.Context()
rclpy.init(context=context)
other = rclpy.create_node("other", context=context)
other.create_publisher(String, "/lidar/points", 10)

imu, cloud, odometry = Imu(), PointCloud2(), Odometry()
imu.header.frame_id = "imu_link"
imu.linear_acceleration.x, imu.linear_acceleration.y, imu.linear_acceleration.z = 0.25, 0.5, 9.75
cloud.header.frame_id = "lidar"
cloud.height, cloud.width, cloud.point_step, cloud.row_step = 1, number, 12, 12 * number
cloud.fields = [PointField(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate("xyz")]
cloud.data = array.array("B", struct.pack("<3f", 1.0, 2.0, 3.0) * number)
odometry.header.frame_id, odometry.child_frame_id = "odom", "base_link"
odometry.pose.pose.position.x = 1.5
odometry.pose.pose.orientation.w = 1.0

end, rounds = time.monotonic() + limit_s, 0
while time.monotonic() < end and not (len(poses) >= 3 and maps and rounds >= 6):
    # Counted from when the gateway has subscribed to all topics: messages before are not delivered.
    rounds += all(publisher.get_subscription_count() for publisher in (imus, clouds, odometries))
    for message, publisher in ((imu, imus), (cloud, clouds), (odometry, odometries)):
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)
    until = time.monotonic() + 0.25
    while time.monotonic() < until:
        rclpy.spin_once(node, timeout_sec=0.05)
# One message of each kind that the gateway drops: without a time, and with a quaternion of NaN.
imu.header.stamp.sec = imu.header.stamp.nanosec = 0
imus.publish(imu)
odometry.header.stamp = node.get_clock().now().to_msg()
odometry.pose.pose.orientation.w = float("nan")
odometries.publish(odometry)
time.sleep(5.0)  # until both are sent, also on a loaded machine
print(
    json.dumps(
        {
            "poses": len(poses),
            "frame": poses[0].header.frame_id if poses else "",
            "z": poses[0].pose.pose.position.z if poses else 0.0,
            "map": [maps[0].info.width, maps[0].info.height, list(maps[0].data)] if maps else None,
        }
    )
)
