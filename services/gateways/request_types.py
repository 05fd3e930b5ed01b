# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Types of the services and actions by which a robot requests products.

``GetGridMap`` and ``GetMap`` are those of ``grid_map_msgs`` and ``nav_msgs``. The definitions of
``cdff_msgs`` are a package of ROS for the robot in ``deploy/ros/cdff_msgs``.
"""

from __future__ import annotations

from dataclasses import dataclass

GET_GRID_MAP, GET_MAP = "grid_map_msgs/srv/GetGridMap", "nav_msgs/srv/GetMap"
REQUEST_SERVICE, REQUEST_ACTION = "cdff_msgs/srv/Request", "cdff_msgs/action/Request"

#: Parameters as in the contract, such as type=dem;region=circle:0,0,10;max_age_s=60.
_REQUEST = "string query\nfloat64 deadline_s\n"
_RESULT = """bool success
string code
string message
string product_id
string metadata
infuse_msgs/Asn1Bitstream product
"""


@dataclass(frozen=True, slots=True)
class RequestType:
    """A service or action type.

    Attributes
    ----------
    definition : str
        Text of its file.
    has_any_product : bool
        Whether it can request any product; else it has one.
    """

    definition: str
    has_any_product: bool = False


SERVICES = {
    GET_GRID_MAP: RequestType(
        "string frame_id\nfloat64 position_x\nfloat64 position_y\nfloat64 length_x\nfloat64 length_y\n"
        "string[] layers\n---\ngrid_map_msgs/GridMap map\n"
    ),
    GET_MAP: RequestType("---\nnav_msgs/OccupancyGrid map\n"),
    REQUEST_SERVICE: RequestType(f"{_REQUEST}---\n{_RESULT}", has_any_product=True),
}
ACTIONS = {
    REQUEST_ACTION: RequestType(
        f"{_REQUEST}---\n{_RESULT}---\nstring state\nstring reason\nfloat64 remaining_s\n",
        has_any_product=True,
    ),
}
