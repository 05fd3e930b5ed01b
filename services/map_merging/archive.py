# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access of map merging to the DPM: pose graphs, clouds or visual maps, and anchors."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.codecs import decode_payload, encode_payload
from cdff_common.errors import FrameNotFoundError, InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.interfaces.product import Header, Quality, product_id
from cdff_common.types import Pointcloud, PoseGraph
from cdff_common.types.visual_map_ext import KeyframePoints
from cdff_core.map_merging.joint_pose_graph import PRODUCER, SITE, MergedMaps
from cdff_core.map_merging.robot_maps import KeyframeId, RobotMap
from services.signing import Sign

#: Product of a visual map.
VISUAL_MAP = "visual_map"
#: Timeout of a call; no client waits for the merging, so that it can wait for a busy DPM.
_CALL_S = 60.0
#: Author of the revisions by ``write`` in the DPM.
_AUTHOR = f"{keys.GROUND}/rpc"


class MapArchive:
    """Maps, clouds and anchors in the DPM.

    Parameters
    ----------
    bus : Bus
    config : MergingConfig
    sign : Sign, optional
        Signs the merged graphs.
    """

    def __init__(self, bus: Bus, config: MergingConfig, sign: Sign | None = None) -> None:
        self._bus, self._config, self._sign = bus, config, sign
        self._graphs: dict[str, PoseGraph] = {}
        self._points: dict[str, dict[int, KeyframePoints]] = {}
        self._revisions: dict[str, int] = {}
        self._inputs: dict[str, str] = {}

    def robot_map(self, robot: str) -> RobotMap | None:
        """Return the newest pose graph of a robot with the anchor of its frame; None while one is missing.

        The survey is the last revision by another author: that of the profile, or one set over HTTP.

        Raises
        ------
        InputError
            If the parent of the frame is not the site, or the survey has no covariance.
        """
        try:
            graph, header = self._newest_map(robot)
            parameters = {"frame": header.frame}
            revisions = self._bus.call(
                keys.dpm_rpc(keys.GROUND, "frames"), parameters, timeout_s=_CALL_S
            ).body()["revisions"]
        except (ProductNotFoundError, FrameNotFoundError):
            return None
        last = revisions[-1]
        survey = next((r for r in reversed(revisions) if r["producer"] != _AUTHOR), revisions[0])
        if (parent := last["parent"]) != SITE:
            raise InputError(
                f"frame {header.frame}: parent {parent}, expected {SITE}: its map cannot be re-anchored"
            )
        if survey["covariance"] is None:
            raise InputError(
                f"frame {header.frame}, revision {survey['revision']}: expected a covariance; set one"
            )
        self._revisions[header.frame], self._inputs[robot] = int(last["revision"]), header.id
        return RobotMap(robot, graph, *(UncertainTransform(r["T"], r["covariance"]) for r in (survey, last)))

    def merged_graph(self) -> PoseGraph | None:
        """Return the newest joint graph; None without one."""
        try:
            return self._newest_graph(keys.GROUND)[0]
        except ProductNotFoundError:
            return None

    def local_points(self, robot_map: RobotMap, keyframe: KeyframeId) -> KeyframePoints:
        """Return the points of a keyframe of a visual map, in its frame.

        Raises
        ------
        ProductNotFoundError
            If the visual map does not contain the keyframe.
        """
        points = self._points.get(robot_map.robot, {}).get(keyframe.stamp_ns)
        if points is None:
            raise ProductNotFoundError(
                f"visual map of {keyframe.robot}: no keyframe at {keyframe.stamp_ns} ns"
            )
        return points

    def local_cloud(self, robot_map: RobotMap, keyframe: KeyframeId) -> Pointcloud:
        """Return the points around a keyframe, in its frame.

        Raises
        ------
        ProductNotFoundError
            If there is no cloud of that time.
        """
        T, around_ns = robot_map.keyframes[keyframe], round(self._config.cloud_s * 1e9)
        parameters = {
            "type": "pointcloud",
            "robot": keyframe.robot,
            "frame": robot_map.graph.frame,
            "region": f"circle:{T[0, 3]:.3f},{T[1, 3]:.3f},{self._config.cloud_radius_m:g}",
            "t0": keyframe.stamp_ns - around_ns,
            "t1": keyframe.stamp_ns + around_ns,
            "points": self._config.cloud_points,
        }
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), parameters, timeout_s=_CALL_S)
        cloud = decode_payload(reply.payload, reply.encoding)
        points_m = se3.transform_points(se3.inverse(T), cloud.points_m)
        return Pointcloud.from_points(points_m, frame=f"{keyframe.robot}/place", stamp_ns=keyframe.stamp_ns)

    def write(
        self,
        merged: MergedMaps,
        maps: Sequence[RobotMap],
        moved_robots: Sequence[str],
        metrics: Mapping[str, float],
    ) -> str:
        """Insert the graph and revise the frames of ``moved_robots`` in one transaction.

        Return the id of the graph.

        Raises
        ------
        ConflictError
            If another client has revised one of the frames since they were read.
        """
        value = merged.graph
        stamps = value.vertices.stamps_ns
        t0_ns, t1_ns = int(stamps.min()), int(stamps.max())
        inputs = tuple(self._inputs[robot_map.robot] for robot_map in maps)
        payload, encoding = encode_payload(value)
        content = payload + repr((inputs, sorted(metrics.items()))).encode()
        config_hash = hashlib.sha256(content).hexdigest()[:16]  # equal content has an equal id
        header = Header(
            id=product_id(keys.GROUND, PRODUCER, "graph", t1_ns, 0, config_hash),
            seq=0,
            t0_ns=t0_ns,
            t1_ns=t1_ns,
            frame=SITE,
            producer=PRODUCER,
            config_hash=config_hash,
            inputs=inputs,
            box_m=value.extent_m(),
            quality=Quality(metrics=dict(metrics)),
        )
        names = {"robot": keys.GROUND, "dfpc": PRODUCER, "port": "graph", "product": "pose_graph"}
        if self._sign is not None:
            header = self._sign(names, encoding, header, payload)
        changes: list[dict[str, Any]] = [
            {
                "do": "insert",
                **names,
                "encoding": encoding,
                "attachment": header.to_attachment(),
                "payload": payload,
            }
        ]
        for robot_map in maps:
            if robot_map.robot in moved_robots:
                T = merged.anchors[robot_map.robot]
                assert T.covariance is not None  # of the solver
                changes.append(
                    {
                        "do": "reanchor",
                        "frame": robot_map.graph.frame,
                        "parent": SITE,
                        "T": T.matrix.tolist(),
                        "covariance": np.asarray(T.covariance).tolist(),
                        "expected_revision": self._revisions[robot_map.graph.frame],
                    }
                )
        self._bus.call(keys.dpm_rpc(keys.GROUND, "transact"), payload=pack(changes), timeout_s=_CALL_S)
        return header.id

    def _newest_map(self, robot: str) -> tuple[PoseGraph, Header]:
        """Return the graph of the newest map of a robot; the points of a visual map are stored."""
        if self._config.maps == "lidar":
            return self._newest_graph(robot)
        parameters = {"type": VISUAL_MAP, "robot": robot}
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), parameters, timeout_s=_CALL_S)
        header = Header.from_dict(reply.attachment)
        if self._inputs.get(robot) != header.id:  # the points are decoded once
            visual_map = decode_payload(reply.payload, reply.encoding)
            stamps_ns = visual_map.graph.vertices.stamps_ns.tolist()
            self._points[robot] = dict(zip(stamps_ns, visual_map.keyframes, strict=True))
            self._graphs[robot] = visual_map.graph
        return self._graphs[robot], header

    def _newest_graph(self, robot: str) -> tuple[PoseGraph, Header]:
        parameters = {"type": "pose_graph", "robot": robot}
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), parameters, timeout_s=_CALL_S)
        return decode_payload(reply.payload, reply.encoding), Header.from_dict(reply.attachment)
