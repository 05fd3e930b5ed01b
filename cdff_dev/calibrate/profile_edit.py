# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replacement of the mounts in the text of a profile, which keeps its comments and everything else."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import yaml

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3


def with_mounts(text: str, robot: str, mounts: Mapping[str, UncertainTransform]) -> str:
    """Return the text of a profile with other mounts below ``{robot}/base``; see ``with_frames``."""
    return with_frames(text, robot, f"{robot}/base", mounts)


def with_frames(text: str, robot: str, parent: str, frames: Mapping[str, UncertainTransform]) -> str:
    """Return the text of a profile with other transforms of the frames below ``parent``.

    Raises
    ------
    InputError
        If a frame has no edge in ``frames`` of the robot with this parent.
    """
    replacements = []
    edges = _edges(text, robot, parent)
    for frame, T in frames.items():
        if frame not in edges:
            known = ", ".join(edges) or "none"
            raise InputError(f"frame {frame!r}: no edge below {parent} in the profile; it has {known}")
        start, end = edges[frame]
        replacements.append((start, end, edge_text(parent, frame, T)))
    for start, end, new in sorted(replacements, reverse=True):
        # The mark of a block mapping is after its last line break and the indentation that follows.
        trailing = text[start:end][len(text[start:end].rstrip()) :]
        text = text[:start] + new + trailing + text[end:]
    return text


def edge_text(parent: str, child: str, T: UncertainTransform) -> str:
    """Return an edge as a flow mapping; its standard deviations are the largest of an axis."""
    q = se3.quaternion_xyzw_from_matrix(T.matrix[:3, :3])
    parts = [
        f"parent: {parent}",
        f"child: {child}",
        f"translation_m: [{', '.join(f'{v:.4f}' for v in T.matrix[:3, 3])}]",
        f"quaternion_xyzw: [{', '.join(f'{v:.6f}' for v in q)}]",
    ]
    if T.covariance is not None:
        sigma = np.sqrt(np.diag(T.covariance))
        parts += [f"sigma_m: {sigma[:3].max():.4f}", f"sigma_deg: {np.rad2deg(sigma[3:]).max():.3f}"]
    return "{" + ", ".join(parts) + "}"


def _edges(text: str, robot: str, parent: str) -> dict[str, tuple[int, int]]:
    """Return start and end of the text of each edge below a frame, by its child."""
    document = yaml.compose(text, Loader=yaml.SafeLoader)
    range_by_child: dict[str, tuple[int, int]] = {}
    for owner in _items(document, "robots"):
        if _scalar(owner, "id") != robot:
            continue
        for edge in _items(owner, "frames"):
            child = _scalar(edge, "child")
            if child is not None and _scalar(edge, "parent") == parent:
                range_by_child[child] = (edge.start_mark.index, edge.end_mark.index)
    return range_by_child


def _value(node: yaml.Node | None, key: str) -> yaml.Node | None:
    if not isinstance(node, yaml.MappingNode):
        return None
    return next((value for name, value in node.value if name.value == key), None)


def _items(node: yaml.Node | None, key: str) -> list[yaml.Node]:
    value = _value(node, key)
    return list(value.value) if isinstance(value, yaml.SequenceNode) else []


def _scalar(node: yaml.Node, key: str) -> str | None:
    value = _value(node, key)
    return str(value.value) if isinstance(value, yaml.ScalarNode) else None
