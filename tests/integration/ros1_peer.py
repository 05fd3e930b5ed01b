# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A ROS 1 program with Debian's rospy, in its Python: test_gateway_ros1.py runs it.

It publishes IMU samples, a cloud, a transform and a message of another type than the gateway expects, until
it has received a pose, a map, a transform and a bitstream, and the DEM of a service;
then it prints them as JSON.
"""

import json
import math
import sys
import threading

import genpy.dynamic
import rospy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs import point_cloud2
from sensor_msgs.msg import Imu
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

SEPARATOR = "=" * 80 + "\n"
HEADER = SEPARATOR + "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
BITSTREAM = "std_msgs/Header header\nstring type\nuint8 serialization_method\nuint8[] data\n" + HEADER
REQUEST = (
    "string frame_id\nfloat64 position_x\nfloat64 position_y\n"
    "float64 length_x\nfloat64 length_y\nstring[] layers\n"
)
GRID_MAP = (
    "grid_map_msgs/GridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
    "std_msgs/Float32MultiArray[] data\n"
    "uint16 outer_start_index\nuint16 inner_start_index\n"
)
RESPONSE = (
    "grid_map_msgs/GridMap map\n"
    + SEPARATOR
    + "MSG: grid_map_msgs/GridMap\n"
    + GRID_MAP
    + SEPARATOR
    + "MSG: grid_map_msgs/GridMapInfo\nstd_msgs/Header header\nfloat64 resolution\nfloat64 length_x\n"
    + "float64 length_y\ngeometry_msgs/Pose pose\n"
    + HEADER
    + SEPARATOR
    + "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    + SEPARATOR
    + "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    + SEPARATOR
    + "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    + SEPARATOR
    + "MSG: std_msgs/Float32MultiArray\nstd_msgs/MultiArrayLayout layout\nfloat32[] data\n"
    + SEPARATOR
    + "MSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
    + SEPARATOR
    + "MSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
)


def dynamic(name, text):
    """Return the class of a type that Debian does not have."""
    return genpy.dynamic.generate_dynamic(name, text)[name]


class GetGridMap:
    """``grid_map_msgs/GetGridMap`` with the sum that its package has."""

    _type, _md5sum = "grid_map_msgs/GetGridMap", "802c2cbc7b10fada2d44db75ddb8c738"
    _request_class = dynamic("grid_map_msgs/GetGridMapRequest", REQUEST)
    _response_class = dynamic("grid_map_msgs/GetGridMapResponse", RESPONSE)


def main():
    rospy.init_node("peer", disable_signals=True)
    received, lock = {}, threading.Lock()

    def take(name):
        def on_message(message):
            with lock:
                received.setdefault(name, message)

        return on_message

    bitstream = dynamic("infuse_msgs/asn1_bitstream", BITSTREAM)
    for topic, kind in (
        ("/cdff/pose", PoseWithCovarianceStamped),
        ("/map", OccupancyGrid),
        ("/cdff/bits", bitstream),
    ):
        rospy.Subscriber(topic, kind, take(topic))

    def on_transform(message):
        for transform in message.transforms:
            if transform.header.frame_id == "odom":  # the others are those of this program
                take("/tf")(transform)

    rospy.Subscriber("/tf", TFMessage, on_transform)
    imu = rospy.Publisher("/imu/data", Imu, queue_size=10)
    cloud = rospy.Publisher("/lidar/points", point_cloud2.PointCloud2, queue_size=10)
    tree = rospy.Publisher("/tf", TFMessage, queue_size=10)
    wrong = rospy.Publisher("/odom", PoseStamped, queue_size=10)
    bits = rospy.Publisher("/rover/pose_infuse", bitstream, queue_size=10, latch=True)
    bits.publish(
        bitstream(Header(stamp=rospy.Time.now()), "asn1SccTime", 0, list(bytes.fromhex(sys.argv[1])))
    )
    connected = 0
    topics = {"/cdff/pose", "/map", "/cdff/bits", "/tf"}
    while True:
        now = rospy.Time.now()
        sample = Imu(header=Header(stamp=now, frame_id="imu_link"))
        sample.linear_acceleration.x, sample.angular_velocity.z = 0.25, 0.125
        imu.publish(sample)
        points = [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]
        cloud.publish(point_cloud2.create_cloud_xyz32(Header(stamp=now, frame_id="lidar"), points))
        transform = TransformStamped(header=Header(stamp=now, frame_id="base_link"), child_frame_id="mast")
        transform.transform.translation.z, transform.transform.rotation.w = 1.5, 1.0
        loop = TransformStamped(header=Header(stamp=now, frame_id="mast"), child_frame_id="base_link")
        loop.transform.rotation.w = 1.0
        tree.publish(TFMessage([transform, loop]))
        wrong.publish(PoseStamped(header=Header(stamp=now)))
        connected += all(publisher.get_num_connections() for publisher in (imu, cloud, tree))
        with lock:
            if topics <= set(received) and connected > 20:
                break
        rospy.sleep(0.05)
    rospy.wait_for_service("/cdff/get_dem", 20)
    layers = ["mean"]
    answer = rospy.ServiceProxy("/cdff/get_dem", GetGridMap)(
        frame_id="map", position_x=0.5, position_y=0.5, length_x=1.0, length_y=1.0, layers=layers
    )
    pose, grid, bits_back = (received[name] for name in ("/cdff/pose", "/map", "/cdff/bits"))
    result = {
        "pose": [pose.header.frame_id, pose.pose.pose.position.z],
        "map": [grid.header.frame_id, list(grid.data)],
        "tf": [received["/tf"].header.frame_id, received["/tf"].transform.translation.x],
        "bits": [bits_back.type, bytes(bits_back.data).hex()],
        "dem": [
            answer.map.info.header.frame_id,
            sorted({v for v in answer.map.data[0].data if math.isfinite(v)}),
        ],
        "use_sim_time": rospy.get_param("/use_sim_time", None),
    }
    print(json.dumps(result), flush=True)
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main()
