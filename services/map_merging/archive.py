# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the merging of maps reads from the DPM, and what it writes there in one transaction."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string, parse_encoding
from cdff_common.codecs.siblings import wire_type
from cdff_common.errors import FrameNotFoundError, InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.interfaces.product import Header, Quality, product_id
from cdff_common.types import Pointcloud, PoseGraph
from cdff_core.map_merging.places import Place, RobotMap
from cdff_core.map_merging.solving import PRODUCER, SITE, Merged

#: Nobody waits for the merging: it rather waits for a DPM that is busy.
_CALL_S = 60.0
#: Whom the DPM enters as author of what ``write`` revises.
_AUTHOR = f"{keys.GROUND}/rpc"


class Archive:
    """Maps, surroundings and anchors in the DPM.

    Parameters
    ----------
    bus : Bus
    config : MergingConfig
    """

    def __init__(self, bus: Bus, config: MergingConfig) -> None:
        self._bus, self._config = bus, config
        self._revisions: dict[str, int] = {}
        self._inputs: dict[str, str] = {}

    def map_of(self, robot: str) -> RobotMap | None:
        """The newest pose graph of a robot with the anchor of its frame; None while one of them is not there.

        Its survey is the last revision that was not made here: the profile's, or one that was set by hand over HTTP.

        Raises
        ------
        InputError
            If the frame does not hang on the site itself, or its survey has no covariance.
        """
        try:
            graph, header = self._newest_graph(robot)
            asked = {"frame": header.frame}
            found = self._bus.call(keys.dpm_rpc(keys.GROUND, "frames"), asked, timeout_s=_CALL_S).body()["revisions"]
        except (ProductNotFoundError, FrameNotFoundError):
            return None
        last = found[-1]
        surveyed = next((r for r in reversed(found) if r["producer"] != _AUTHOR), found[0])
        if (hangs_on := last["parent"]) != SITE:
            raise InputError(
                f"frame {header.frame} hangs on {hangs_on}, expected {SITE}: its map cannot be re-anchored"
            )
        if surveyed["covariance"] is None:
            raise InputError(f"frame {header.frame}, revision {surveyed['revision']}: expected a covariance; set one")
        self._revisions[header.frame], self._inputs[robot] = int(last["revision"]), header.id
        return RobotMap(robot, graph, *(UncertainTransform(r["T"], r["covariance"]) for r in (surveyed, last)))

    def merged_graph(self) -> PoseGraph | None:
        """The newest graph of all robots; None while there is none."""
        try:
            return self._newest_graph(keys.GROUND)[0]
        except ProductNotFoundError:
            return None

    def surroundings(self, robot_map: RobotMap, place: Place) -> Pointcloud:
        """Points around a key frame, in its frame.

        Raises
        ------
        ProductNotFoundError
            If no cloud of its time is there.
        """
        T, around_ns = robot_map.places[place], round(self._config.cloud_s * 1e9)
        asked = {
            "type": "pointcloud", "robot": place.robot, "frame": robot_map.graph.frame,
            "region": f"circle:{T[0, 3]:.3f},{T[1, 3]:.3f},{self._config.cloud_radius_m:g}",
            "t0": place.stamp_ns - around_ns, "t1": place.stamp_ns + around_ns, "points": self._config.cloud_points,
        }  # fmt: skip
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=_CALL_S)
        cloud = _value(reply.payload, reply.encoding)
        points_m = se3.transform_points(se3.inverse(T), cloud.points_m)
        return Pointcloud.from_points(points_m, frame=f"{place.robot}/place", stamp_ns=place.stamp_ns)

    def write(
        self, merged: Merged, maps: Sequence[RobotMap], moved: Sequence[str], metrics: Mapping[str, float]
    ) -> str:
        """Insert the graph and revise the frames of the robots that ``moved``, all or nothing; the id of the graph.

        Raises
        ------
        ConflictError
            If somebody else has revised one of the frames meanwhile.
        """
        value = merged.graph
        stamps = value.vertices.stamps_ns
        t0_ns, t1_ns = int(stamps.min()), int(stamps.max())
        used = tuple(self._inputs[m.robot] for m in maps)
        payload = encode(value, "uper")
        content = payload + repr((used, sorted(metrics.items()))).encode()
        config_hash = hashlib.sha256(content).hexdigest()[:16]  # what is the same again has the same id
        header = Header(
            id=product_id(keys.GROUND, PRODUCER, "graph", t1_ns, 0, config_hash), seq=0, t0_ns=t0_ns, t1_ns=t1_ns,
            frame=SITE, producer=PRODUCER, config_hash=config_hash, inputs=used, box_m=value.extent_m(),
            quality=Quality(metrics=dict(metrics)),
        )  # fmt: skip
        changes: list[dict[str, Any]] = [
            {
                "do": "insert", "robot": keys.GROUND, "dfpc": PRODUCER, "port": "graph", "product": "pose_graph",
                "encoding": encoding_string(wire_type(value), "uper"), "attachment": header.to_attachment(),
                "payload": payload,
            }
        ]  # fmt: skip
        for m in maps:
            if m.robot in moved:
                T = merged.anchors[m.robot]
                assert T.covariance is not None  # the solver states one
                changes.append(
                    {
                        "do": "reanchor", "frame": m.graph.frame, "parent": SITE, "T": T.matrix.tolist(),
                        "covariance": np.asarray(T.covariance).tolist(),
                        "expected_revision": self._revisions[m.graph.frame],
                    }
                )  # fmt: skip
        self._bus.call(keys.dpm_rpc(keys.GROUND, "transact"), payload=pack(changes), timeout_s=_CALL_S)
        return header.id

    def _newest_graph(self, robot: str) -> tuple[PoseGraph, Header]:
        asked = {"type": "pose_graph", "robot": robot}
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=_CALL_S)
        return _value(reply.payload, reply.encoding), Header.from_dict(reply.attachment)


def _value(payload: bytes, encoding: str) -> Any:
    name, codec = parse_encoding(encoding)
    return decode(name, payload, codec)
