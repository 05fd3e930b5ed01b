# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One pose graph of all robots, and where it puts the frame of each map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.interfaces.registry import Registry
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, PRIOR
from cdff_core.dfns.pose_graph_optimization._interface import PoseGraphOptimizationInputs, PoseGraphOptimizationOutputs
from cdff_core.map_merging.places import Closure, Float, Place, RobotMap

#: Ids of a robot's vertices in the graph of all begin at its place among the robots times this.
ROBOT_IDS = 1_000_000
SITE = "site"
PRODUCER = "map_merging"
_LEAST_SIGMA = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Merged:
    """What came out.

    Attributes
    ----------
    graph : PoseGraph
        Key frames of all robots in the site; closures that contradict the rest are left out.
    anchors : mapping of str to UncertainTransform
        ``T_site_map`` of each robot.
    bent_m : mapping of str to float
        How far the graph moves a key frame of the robot at most against the map as the robot has it: what an anchor,
        which is rigid, cannot say.
    rejected : tuple of Closure
    """

    graph: PoseGraph
    anchors: Mapping[str, UncertainTransform]
    bent_m: Mapping[str, float]
    rejected: tuple[Closure, ...]


class MapMerger:
    """Solve the graph of all maps: each robot's own measurements, the survey of each map's begin, the closures.

    Parameters
    ----------
    config : MergingConfig
    robots : sequence of str
        All that may have a map: their order gives the ids in the graph.
    """

    def __init__(self, config: MergingConfig, robots: Sequence[str]) -> None:
        self._first_id = first_ids(robots)
        self._optimise: Dfn[Any, PoseGraphOptimizationInputs, PoseGraphOptimizationOutputs] = (
            Registry.default().make_dfn("pose_graph_optimization", "ChordalGaussNewton")
        )
        self._optimise.configure(config.optimise)

    def merged(self, maps: Sequence[RobotMap], closures: Sequence[Closure]) -> Merged:
        """Solve; maps that no closure links with another stay where the survey puts them."""
        ids = {place: self._first_id[m.robot] + row for m in maps for row, place in enumerate(m.places)}
        linked = [c for c in closures if c.first in ids and c.second in ids]
        graph = _graph_of_all(maps, linked, ids)
        roots = np.array([self._first_id[m.robot] + m.root for m in maps], dtype=np.int64)
        found = self._optimise.process(PoseGraphOptimizationInputs(graph, roots))
        kept = found.weights > 0.5
        solved = dict(zip(found.graph.vertices.ids.tolist(), found.graph.vertices.matrices, strict=True))
        anchors, bent_m = {}, {}
        for m, root, covariance in zip(maps, roots.tolist(), found.covariances, strict=True):
            inside = np.array(list(m.places.values()))
            outside = np.array([solved[ids[place]] for place in m.places])
            T = rigid_fit(outside, inside)
            bent_m[m.robot] = float(np.linalg.norm((T @ inside - outside)[:, :3, 3], axis=1).max())
            T_map_root = UncertainTransform(m.graph.vertices.matrices[m.root], np.zeros((6, 6)))
            at_root = UncertainTransform(solved[root], covariance)
            anchors[m.robot] = UncertainTransform(T, (at_root @ T_map_root.inverse()).covariance)
        rejected = tuple(c for c, ok in zip(linked, kept[len(kept) - len(linked) :], strict=True) if not ok)
        return Merged(_without(found.graph, kept), anchors, bent_m, rejected)


def first_ids(robots: Sequence[str]) -> dict[str, int]:
    """Where the ids of each robot's vertices begin."""
    return {robot: ROBOT_IDS * number for number, robot in enumerate(sorted(robots))}


def rigid_fit(outside: Float, inside: Float) -> Float:
    """``T`` that brings poses ``inside`` nearest to ``outside``, both (n, 4, 4): by mean rotation, then mean shift."""
    R = se3.normalise_rotation((outside[:, :3, :3] @ np.swapaxes(inside[:, :3, :3], 1, 2)).mean(axis=0))
    shift = (outside[:, :3, 3] - inside[:, :3, 3] @ R.T).mean(axis=0)
    return se3.transform(R, shift)


def closures_of(graph: PoseGraph, robots: Sequence[str]) -> list[Closure]:
    """The closures between robots that a merged graph holds.

    Parameters
    ----------
    robots : sequence of str
        Those that it was made of.
    """
    names = {first: robot for robot, first in first_ids(robots).items()}
    place = {
        i: Place(names[i - i % ROBOT_IDS], t)
        for i, t in zip(graph.vertices.ids.tolist(), graph.vertices.stamps_ns.tolist(), strict=True)
        if i - i % ROBOT_IDS in names
    }
    e = graph.edges
    rows = zip(e.ends.tolist(), e.matrices, e.information_matrices, strict=True)
    return [
        Closure(place[a], place[b], UncertainTransform(T, np.linalg.inv(information)))
        for (a, b), T, information in rows
        if a in place and b in place and place[a].robot != place[b].robot
    ]


def _graph_of_all(maps: Sequence[RobotMap], closures: Sequence[Closure], ids: Mapping[Place, int]) -> PoseGraph:
    """Vertices and edges of all maps, a prior on each root, then the closures."""
    ends, Ts, information, kinds = [], [], [], []
    for m in maps:
        of_place = [ids[place] for place in m.places]
        of_key = dict(zip(m.graph.vertices.ids.tolist(), of_place, strict=True))
        e = m.graph.edges
        ends += [(of_key[a], of_key[b]) for a, b in e.ends.tolist()]
        Ts += list(e.matrices)
        information += list(e.information_matrices)
        kinds += e.kinds.tolist()
        root = of_place[m.root]
        T_site_root = m.surveyed @ UncertainTransform(m.graph.vertices.matrices[m.root], np.zeros((6, 6)))
        ends.append((root, root))
        Ts.append(T_site_root.matrix)
        information.append(_information(T_site_root))
        kinds.append(PRIOR)
    for closure in closures:
        ends.append((ids[closure.first], ids[closure.second]))
        Ts.append(closure.T.matrix)
        information.append(_information(closure.T))
        kinds.append(LOOP_CLOSURE)
    start = [m.anchor.matrix @ T for m in maps for T in m.places.values()]
    return PoseGraph.from_arrays(
        list(ids.values()), [place.stamp_ns for place in ids], np.array([_rigid(T) for T in start]), np.array(ends),
        np.array([_rigid(T) for T in Ts]), np.array(information), kinds, frame=SITE, producer=PRODUCER,
    )  # fmt: skip


def _without(graph: PoseGraph, kept: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> PoseGraph:
    """The graph with those edges only."""
    v, e = graph.vertices, graph.edges
    return PoseGraph.from_arrays(
        v.ids, v.stamps_ns, v.matrices, e.ends[kept], e.matrices[kept], e.information_matrices[kept], e.kinds[kept],
        frame=graph.frame, fixed=v.fixed, producer=PRODUCER,
    )  # fmt: skip


def _information(T: UncertainTransform) -> Float:
    covariance = np.zeros((6, 6)) if T.covariance is None else T.covariance
    information = np.linalg.inv(covariance + _LEAST_SIGMA**2 * np.eye(6))
    return np.asarray(0.5 * (information + information.T))


def _rigid(T: Float) -> Float:
    return se3.transform(se3.normalise_rotation(T[:3, :3]), T[:3, 3])
