# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Requests of the robot: checked, sent to the orchestrator, and answered with the product as a message."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np

from cdff_common.client import Answer, Client
from cdff_common.clock import monotonic_s, wall_ns
from cdff_common.errors import (
    CdffError,
    InputError,
    OverloadedError,
    ProductNotFoundError,
    rpc_code,
)
from services.gateways.counters import RateLimit, TopicCounters
from services.gateways.frames import FrameNames
from services.gateways.product_query import OnProgress, ProductQuery
from services.gateways.request_types import GET_GRID_MAP, GET_MAP
from services.gateways.settings import RequestEntry
from services.ros_messages.encoders import bitstream
from services.ros_messages.encoding import Target
from services.ros_messages.map_encoders import grid_map_message, occupancy_grid
from services.ros_messages.message_types import BITSTREAM, RosTypes

logger = logging.getLogger(__name__)


class ProductRequests:
    """Requests by one service or action of the gateway.

    Parameters
    ----------
    entry : RequestEntry
    response : str
        Name of the type of the response in the type store.
    names : FrameNames
    types : RosTypes
    client : Client
        Connection to the orchestrator.
    """

    def __init__(
        self, entry: RequestEntry, response: str, names: FrameNames, types: RosTypes, client: Client
    ) -> None:
        self.entry, self.counters = entry, TopicCounters()
        self._response, self._names, self._types, self._client = response, names, types, client
        self._rate = RateLimit(entry.max_hz)
        self._answers = {GET_GRID_MAP: self._grid_map, GET_MAP: self._occupancy_grid}

    def answer(self, request: Any, on_progress: OnProgress | None = None) -> Any:
        """Return the response to a request; one that fails has the reason, or of a map no cells."""
        start_s = monotonic_s()
        self.counters.receive(len(getattr(request, "query", "")))
        try:
            if not self._rate.admits(start_s):
                raise OverloadedError(
                    f"{self.entry.name}: more than {self.entry.max_hz:g} requests per second"
                )
            response = self._answers.get(self.entry.type, self._product)(request, on_progress)
        except CdffError as error:
            reason = "rate" if isinstance(error, OverloadedError) else "request"
            if self.counters.drop(reason, f"{type(error).__name__}: {error}"):
                logger.warning("%s: refused: %s", self.entry.name, error)
            return self._refusal(error)
        self.counters.forward(monotonic_s() - start_s)
        return response

    def no_answer(self) -> Any:
        """Return the response to a request that is not known, or was cancelled before it began."""
        return self._refusal(ProductNotFoundError(f"{self.entry.name}: no such request, or it was cancelled"))

    def cancel(self, job: str) -> None:
        """Cancel a request by the job in its progress."""
        self._client.cancel(job, self._names.robot)

    def _grid_map(self, request: Any, on_progress: OnProgress | None) -> Any:
        """Return the layers of the DEM around a position."""
        half = np.array([request.length_x, request.length_y]) / 2.0
        centre = np.array([request.position_x, request.position_y])
        if not (np.isfinite([*half, *centre]).all() and (half > 0.0).all()):
            raise InputError(f"region of {2 * half[0]:g} x {2 * half[1]:g} m: expected lengths above 0")
        frame = self._names.of_cdff(request.frame_id) if request.frame_id else "site"
        region = "bbox:" + ",".join(f"{v:.6f}" for v in (*(centre - half), *(centre + half)))
        value = self._request(
            "dem", {"region": region, "frame": frame}, self.entry.deadline_s, on_progress
        ).value
        names = list(request.layers) or list(value.layer_names)
        layers = {name: np.asarray(value.layer(name), np.float32) for name in names}
        frame_id = self._names.of_robot(value.geometry.frame)
        message = grid_map_message(value.geometry, layers, self._types, value.metadata.stamp_ns, frame_id)
        return self._make(map=message)

    def _occupancy_grid(self, _: Any, on_progress: OnProgress | None) -> Any:
        """Return the navigation map of the region in the settings."""
        options = {} if self.entry.region is None else {"region": self.entry.region}
        value = self._request("navigation_map", options, self.entry.deadline_s, on_progress).value
        encoded = occupancy_grid(
            value, self._target(value.geometry.frame), self._types, value.metadata.stamp_ns
        )
        return self._make(map=encoded.messages[0].message)

    def _product(self, request: Any, on_progress: OnProgress | None) -> Any:
        """Return any listed product as a bitstream, with its metadata as JSON."""
        query = ProductQuery(self.entry.products, self.entry.deadline_s, self._names.robot)
        answer = query.answer(request.query, request.deadline_s, self._client, on_progress)
        target, stamp_ns = self._target(answer.header.frame or ""), answer.header.t1_ns
        message = bitstream(answer.value, target, self._types, stamp_ns).messages[0].message
        metadata = {"header": answer.header.to_dict(), "delivered": dict(answer.delivered)}
        return self._make(
            success=True,
            code="",
            message="",
            product_id=answer.header.id,
            metadata=json.dumps(metadata, default=str),
            product=message,
        )

    def _request(
        self, product: str, options: Mapping[str, Any], deadline_s: float, on_progress: OnProgress | None
    ) -> Answer:
        return self._client.request(
            product, robot=self._names.robot, deadline_s=deadline_s, on_progress=on_progress, **options
        )

    def _refusal(self, error: CdffError) -> Any:
        """Return the response of a request that failed."""
        if self.entry.type == GET_GRID_MAP:
            return self._make(map=grid_map_message(None, {}, self._types, wall_ns(), ""))
        if self.entry.type == GET_MAP:
            return self._make(map=self._empty_grid())
        header = self._types.header(wall_ns(), "")
        kind = BITSTREAM.replace("/msg/", "/")
        empty = self._types.make(
            kind, header=header, type="", serialization_method=0, data=np.zeros(0, np.uint8)
        )
        return self._make(
            success=False,
            code=rpc_code(error)[0],
            message=str(error)[:1000],
            product_id="",
            metadata="",
            product=empty,
        )

    def _empty_grid(self) -> Any:
        header, zero = self._types.header(wall_ns(), ""), np.zeros(3)
        pose = self._types.make(
            "geometry_msgs/Pose",
            position=self._types.vector(zero, "Point"),
            orientation=self._types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
        )
        info = self._types.make(
            "nav_msgs/MapMetaData", map_load_time=header.stamp, resolution=0.0, width=0, height=0, origin=pose
        )
        return self._types.make("nav_msgs/OccupancyGrid", header=header, info=info, data=np.zeros(0, np.int8))

    def _make(self, **fields: Any) -> Any:
        return self._types.store.types[self._response](**fields)

    def _target(self, frame: str) -> Target:
        names = self._names
        return Target(self.entry.name, names.robot, frame, names.of_robot, names.frames, {})
