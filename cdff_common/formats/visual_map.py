# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of visual maps: an npz archive."""

from __future__ import annotations

import numpy as np

from cdff_common.errors import CodecError, InputError
from cdff_common.formats.file_source import Readable, load
from cdff_common.formats.npz import read_npz, write_npz
from cdff_common.types import PoseGraph, VisualMap
from cdff_common.types.visual_map_ext import KeyframePoints

_TEXTS = ("frame", "sensor", "descriptor_type", "producer")


def write_visual_map(value: VisualMap) -> bytes:
    """Return the archive of a map: graph, points and descriptors as arrays."""
    vertices, edges, points = value.graph.vertices, value.graph.edges, value.points
    metadata = value.metadata
    texts = (value.frame, metadata.sensor_id, metadata.descriptor_type, metadata.producer_id)
    return write_npz(
        {
            "ids": vertices.ids,
            "stamps_ns": vertices.stamps_ns,
            "poses": vertices.matrices,
            "ends": edges.ends,
            "edge_poses": edges.matrices,
            "information": edges.information_matrices,
            "kinds": edges.kinds,
            "counts": points.counts,
            "positions_m": points.positions,
            "depth_sigmas_m": points.depth_sigmas,
            "descriptors": points.descriptors.array,
            "stamp_ns": np.array(value.stamp_ns),
            **{name: np.array(text) for name, text in zip(_TEXTS, texts, strict=True)},
        }
    )


def read_visual_map(source: Readable) -> VisualMap:
    """Read a map; raises CodecError with the file name on other content."""
    s = load(source)
    arrays = read_npz(s)
    try:
        graph = PoseGraph.from_arrays(
            arrays["ids"],
            arrays["stamps_ns"],
            arrays["poses"],
            arrays["ends"],
            arrays["edge_poses"],
            arrays["information"],
            arrays["kinds"],
            frame=str(arrays["frame"]),
        )
        ends = np.cumsum(arrays["counts"])[:-1]
        columns = (np.split(arrays[n], ends) for n in ("positions_m", "depth_sigmas_m", "descriptors"))
        keyframes = (
            [KeyframePoints(*rows) for rows in zip(*columns, strict=True)] if len(graph.vertices.ids) else []
        )
        return VisualMap.from_parts(
            graph,
            keyframes,
            sensor=str(arrays["sensor"]),
            stamp_ns=int(arrays["stamp_ns"]),
            descriptor_type=str(arrays["descriptor_type"]),
            producer=str(arrays["producer"]),
        )
    except (KeyError, ValueError, TypeError, InputError) as error:
        raise CodecError(f"{s.name}: {error}; expected a visual map of cdff map build") from error
