# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual map of an earlier drive, which a rover finds in the DPM, and its use in the mission."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from cdff_common.bus import Bus, keys
from cdff_common.codecs import encode_payload
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.registry import Registry
from cdff_common.types import VisualMap
from cdff_dev.missions.script import EarlierDrive, Mission
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.traverse import simulate

MAPPING, LOCALISATION = "visual_slam", "visual_localisation"
_WORKERS, _TIMEOUT_S = 2, 120.0


def map_of_drive(drive: EarlierDrive) -> VisualMap:
    """Return the map that ``visual_slam`` makes of the stereo pairs of a simulated drive.

    Its frame is ``drive.frame``, the pose of the left camera at the first pair; the truth is not used.
    """
    dfpc = Registry.default().make_dfpc(MAPPING)
    dfpc.configure(None, DfpcContext(drive.robot))
    stream = f"/{drive.robot}/navcam.pair"
    for entry, value in simulate(load_scenario(drive.scenario), _WORKERS):
        if entry.stream == stream:
            list(dfpc.step(Sample("pair", entry.stamp_ns, entry.header.seq, value, entry.header.id)))
    (visual_map,) = (output.value for output in dfpc.finish() if output.port == "map")
    graph = replace(visual_map.graph, metadata=replace(visual_map.graph.metadata, frame_id=drive.frame))
    renamed: VisualMap = replace(visual_map, graph=graph)
    return renamed


def store_visual_map(bus: Bus, visual_map: VisualMap, robot: str) -> None:
    """Insert a map into the DPM as product ``visual_map`` of ``robot``."""
    stamp_ns = visual_map.metadata.time_stamp.ns
    header = Header(
        id=product_id(robot, MAPPING, "map", stamp_ns, 0, ""),
        seq=0,
        t0_ns=stamp_ns,
        t1_ns=stamp_ns,
        frame=visual_map.frame,
        producer=MAPPING,
    )
    payload, encoding = encode_payload(visual_map)
    bus.call(
        keys.dpm_rpc(keys.GROUND, "put"),
        {"robot": robot, "dfpc": MAPPING, "port": "map", "product": "visual_map"},
        payload=payload,
        encoding=encoding,
        attachment=header.to_attachment(),
        timeout_s=_TIMEOUT_S,
    )


def located_images(bus: Bus, mission: Mission) -> Iterator[str]:
    """Yield, for each robot, how many of its images were located in the map of the earlier drive."""
    for robot in mission.robots:
        status = bus.call(keys.dfpc_rpc(robot, LOCALISATION, "status")).body()
        total = int(status["samples_by_port"].get("pair", 0))
        failed = int(status["failed"])
        yield f"{robot}: {total - failed} of {total} images located in the map of the earlier drive"
