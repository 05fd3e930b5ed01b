# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of a gateway: the topics and requests that may pass, by direction, and their limits."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, model_validator

from cdff_common.contract.products import requestable_products
from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.sensor_profile import FrameId, Name
from services.gateways.request_types import ACTIONS, SERVICES
from services.gateways.stream_settings import InputStream, OutputStream, RobotSettings
from services.ros_messages.conversions import CONVERSIONS, FRAME_TREES, IMAGES
from services.ros_messages.encoders import ENCODERS
from services.ros_messages.fixes import FIX
from services.ros_messages.mapping import mapping_table
from services.ros_messages.maps import GRID_MAP, OCCUPANCY_GRID
from services.ros_messages.message_types import BITSTREAM

#: Message type of frame trees.
TF = FRAME_TREES[0]
_EXCLUDED = {entry.message for entry in mapping_table().messages if not entry.gateways}
_OUTGOING = {message for messages in ENCODERS.values() for message in messages} - _EXCLUDED | {BITSTREAM, TF}
_INCOMING = set(CONVERSIONS) - _EXCLUDED
#: Message types whose topics are latched by default.
_MAPS = (OCCUPANCY_GRID, GRID_MAP)
#: Topic of the transforms that do not change.
STATIC_TRANSFORMS = "/tf_static"

#: Longitude and latitude, degrees, and height, metres.
Origin = tuple[
    Annotated[float, Field(ge=-180.0, le=360.0)],
    Annotated[float, Field(ge=-90.0, le=90.0)],
    Annotated[float, Field(ge=-1e6, le=1e6)],
]
Topic = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$", max_length=255)]


class InputTopic(InputStream):
    """A topic of the robot whose messages become samples.

    Attributes
    ----------
    topic, type : str
        Topic, and its message type such as ``sensor_msgs/msg/Imu``. A frame tree (``/tf``, ``/tf_static``)
        may be listed several times, once for each transform.
    camera_info : str or None
        For images the topic of the calibration.
    right, right_camera_info : str or None
        For the left images of a stereo camera the topics of the right images, of the same type, and of their
        calibration. The samples are pairs; the calibrations are required.
    qos : "sensor_data", "default" or "latched"
        Quality of service of the subscription. Latched, the default for ``/tf_static`` and maps, receives the
        last message from before the start of the gateway.
    queue : int
        Messages that can wait; with more the oldest is dropped.
    """

    topic: Topic
    type: str
    camera_info: Topic | None = None
    right: Topic | None = None
    right_camera_info: Topic | None = None
    qos: Literal["sensor_data", "default", "latched"] | None = None
    queue: Annotated[int, Field(ge=1, le=1000)] = 16

    @model_validator(mode="after")
    def _type_is_known(self) -> InputTopic:
        if self.type not in _INCOMING:
            raise ValueError(f"type {self.type!r}: expected one of {', '.join(sorted(_INCOMING))}")
        stereo = (self.right, self.right_camera_info)
        if any(stereo) and not (all(stereo) and self.camera_info is not None and self.type in IMAGES):
            raise ValueError("a stereo camera: expected images, right, camera_info and right_camera_info")
        return self

    @property
    def topics(self) -> list[str]:
        """Topics of messages that become samples."""
        return [self.topic] if self.right is None else [self.topic, self.right]

    @property
    def calibrations(self) -> list[str]:
        """Topics of calibrations."""
        return [topic for topic in (self.camera_info, self.right_camera_info) if topic is not None]

    @property
    def is_frame_tree(self) -> bool:
        """True if the messages of the topic hold the transforms of many frames."""
        return self.type in FRAME_TREES

    @property
    def service_quality(self) -> Literal["sensor_data", "default", "latched"]:
        """Quality of service, or its default for the topic."""
        is_latched = self.type in _MAPS or self.topic == STATIC_TRANSFORMS
        return self.qos or ("latched" if is_latched else "default" if self.is_frame_tree else "sensor_data")


class OutputTopic(OutputStream):
    """A product that becomes a topic of the robot.

    Attributes
    ----------
    topic, type : str
        Topic, and its message type. ``tf2_msgs/msg/TFMessage`` for a pose is a transform of the frame tree;
        ``infuse_msgs/msg/Asn1Bitstream`` holds any type.
    latched : bool
        Send the last message to subscribers that join later, as default for maps and ``/tf_static``.
    """

    topic: Topic
    type: str = BITSTREAM
    latched: bool | None = None

    @model_validator(mode="after")
    def _type_is_known(self) -> OutputTopic:
        if self.type not in _OUTGOING:
            raise ValueError(f"type {self.type!r}: expected one of {', '.join(sorted(_OUTGOING))}")
        return self

    @property
    def is_latched(self) -> bool:
        """True if the topic is latched."""
        default = self.type in _MAPS or self.topic == STATIC_TRANSFORMS
        return default if self.latched is None else self.latched


class RequestEntry(StrictModel):
    """A service or an action of the gateway by which the robot requests products.

    Attributes
    ----------
    name, type : str
        Name, and its type: ``grid_map_msgs/srv/GetGridMap`` (a DEM), ``nav_msgs/srv/GetMap`` (a navigation
        map), ``cdff_msgs/srv/Request`` and ``cdff_msgs/action/Request`` (any listed product).
    products : list of str
        Products that may be requested by a type for any product.
    region : str or None
        Region of a type that has none, such as ``near:mana/base,10``.
    deadline_s : float
        Longest time of a request.
    max_hz : float
        Largest rate, requests per second; others are refused.
    """

    name: Topic
    type: str
    products: tuple[str, ...] = ()
    region: str | None = None
    deadline_s: Annotated[float, Field(gt=0.0, le=600.0)] = 20.0
    max_hz: PositiveFloat = 20.0

    @model_validator(mode="after")
    def _is_known(self) -> RequestEntry:
        known = {**SERVICES, **ACTIONS}
        if self.type not in known:
            raise ValueError(f"type {self.type!r}: expected one of {', '.join(known)}")
        unknown = sorted(set(self.products) - set(requestable_products()))
        if unknown:
            raise ValueError(f"product {unknown[0]!r}: expected some of {', '.join(requestable_products())}")
        if bool(self.products) != known[self.type].has_any_product:
            expected = "a list of products" if known[self.type].has_any_product else "no products"
            raise ValueError(f"{self.type}: expected {expected}")
        return self


class GatewaySettings(RobotSettings):
    """Settings of the gateway of a robot. Nothing passes that is not listed.

    Attributes
    ----------
    node : str
        Name of the gateway's node.
    inputs : list of InputTopic
    outputs : list of OutputTopic
        Empty: the gateway publishes nothing on the robot.
    requests : list of RequestEntry
        Empty: the robot can request nothing.
    parameters : mapping of DFPC to list of str
        Parameters of DFPCs that are parameters of the node. Empty: the robot can change none.
    origins : mapping of frame to (longitude, latitude, height)
        Locations of frames on the Earth, degrees and metres above the ellipsoid of WGS 84; x is east, y is
        north.
    clock : bool
        Publish the mission clock as ``/clock``, for nodes with ``use_sim_time``.
    """

    node: Name = "cdff_gateway"
    inputs: tuple[InputTopic, ...] = ()
    outputs: tuple[OutputTopic, ...] = ()
    requests: tuple[RequestEntry, ...] = ()
    parameters: dict[str, tuple[str, ...]] = {}
    origins: dict[FrameId, Origin] = {}
    clock: bool = False

    @model_validator(mode="after")
    def _is_unambiguous(self) -> GatewaySettings:
        incoming = [topic for entry in self.inputs if not entry.is_frame_tree for topic in entry.topics]
        trees = {entry.topic for entry in self.inputs if entry.is_frame_tree}
        streams = [entry.stream for entry in self.inputs]
        for what, names in (("topic", [*incoming, *trees]), ("stream", streams)):
            if len(set(names)) != len(names):
                raise ValueError(f"inputs have a {what} twice: {', '.join(names)}")
        calibrations = {topic for entry in self.inputs for topic in entry.calibrations}
        if both := sorted({*incoming, *trees} & calibrations):
            raise ValueError(f"topic {both[0]} is an input and a camera_info: expected two topics")
        self._check_directions({*incoming, *trees})
        self._check_outputs()
        unlocated = [e for e in self.inputs if e.type == FIX and (e.frame not in self.origins or not e.child)]
        if unlocated:
            raise ValueError(
                f"input {unlocated[0].topic}: expected the location of frame {unlocated[0].frame} under "
                "origins, and the frame of the receiver as child"
            )
        names = [entry.name for entry in self.requests]
        if len(set(names)) != len(names):
            raise ValueError(f"requests have a name twice: {', '.join(names)}")
        return self

    def _check_directions(self, incoming: set[str]) -> None:
        """Refuse a topic in both directions, but a frame tree, of which each side has its own transforms."""
        poses = {e.topic for e in self.outputs if e.type == TF} & {
            e.topic for e in self.inputs if e.is_frame_tree
        }
        both = sorted({entry.topic for entry in self.outputs} & incoming - poses)
        if both:
            raise ValueError(f"topic {both[0]} is input and output: its messages would circulate")

    def _check_outputs(self) -> None:
        """Refuse two products of one topic with different types, or of which one is latched."""
        known: dict[str, OutputTopic] = {}
        for entry in self.outputs:
            first = known.setdefault(entry.topic, entry)
            if entry.type != first.type:
                raise ValueError(
                    f"output topic {entry.topic} has the types {first.type} and {entry.type}: expected one"
                )
            if entry.is_latched != first.is_latched:
                raise ValueError(
                    f"output topic {entry.topic} is latched for one product and not for another: "
                    "state the same latched for both"
                )
