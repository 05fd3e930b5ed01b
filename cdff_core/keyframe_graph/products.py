# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory and graph of a SLAM as products."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, Generic, Protocol, TypeVar

from cdff_common.errors import ProductNotFoundError
from cdff_common.interfaces.dfpc import Output
from cdff_common.interfaces.product import Quality
from cdff_common.types import PoseGraph, PoseTrajectory
from cdff_core.keyframe_graph.graph import KeyframeGraph
from cdff_core.keyframe_graph.trajectory import Trajectory


class Mapper(Protocol):
    """Map under construction."""

    trajectory: Trajectory

    @property
    def keyframes(self) -> KeyframeGraph[Any]:
        """Keyframes and pose graph."""


MapperT = TypeVar("MapperT", bound=Mapper)


class GraphProducts(ABC, Generic[MapperT]):
    """Builds the products of trajectory and graph in the map frame."""

    def __init__(self, producer: str, map_frame: str, mapper: MapperT) -> None:
        self._producer, self._map_frame, self._mapper = producer, map_frame, mapper

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest keyframe, or of the newest pose if that is later."""
        return max(self._mapper.keyframes.last_ns, self._mapper.trajectory.last_ns)

    def graph(self) -> PoseGraph:
        """Return the pose graph of the linked keyframes; other keyframes have no known pose in the map."""
        keyframes = self._mapper.keyframes
        return keyframes.to_graph(keyframes.linked, frame=self._map_frame, producer=self._producer)

    def trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """Return ``T_map_sensor`` between two times; raises ProductNotFoundError without a pose there."""
        mapper = self._mapper
        stamps, poses, covariances = mapper.trajectory.in_map(mapper.keyframes, t0_ns, t1_ns)
        if not len(stamps):
            raise ProductNotFoundError(f"{self._producer}: no pose between {t0_ns} and {t1_ns}")
        return PoseTrajectory.from_arrays(
            stamps,
            poses,
            covariances,
            parent=self._map_frame,
            child=self.sensor_frame,
            producer=self._producer,
        )

    def stored_trajectory(self) -> PoseTrajectory | None:
        """Return the whole trajectory; None if no pose in the map is known."""
        is_localised = self._mapper.trajectory.is_localised(self._mapper.keyframes)
        return self.trajectory(-1, -1) if is_localised else None

    def reports(self, stamp_ns: int | None = None) -> Iterator[Output]:
        """Yield the current trajectory and graph."""
        quality, frame = self.map_quality(), self._map_frame
        span = (self._mapper.keyframes.first_ns, self.newest_ns if stamp_ns is None else stamp_ns)
        if (trajectory := self.stored_trajectory()) is not None:
            yield Output("trajectory", trajectory, *span, frame, self.sensor_frame, quality, self.inputs)
        yield Output("graph", self.graph(), *span, frame, None, quality, self.inputs)

    @property
    @abstractmethod
    def sensor_frame(self) -> str:
        """Frame of the sensor."""

    @property
    @abstractmethod
    def inputs(self) -> tuple[str, ...]:
        """Ids of the newest inputs."""

    @abstractmethod
    def map_quality(self) -> Quality:
        """Return the quality of the map."""

    def require_map(self) -> None:
        """Raise ProductNotFoundError without a keyframe."""
        if not len(self._mapper.keyframes):
            raise ProductNotFoundError(f"{self._producer}: nothing has been mapped yet")
