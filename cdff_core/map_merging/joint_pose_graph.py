# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Joint pose graph of all robots, from which the anchor of each map follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import information_from_covariance
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.interfaces.registry import Registry
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE, PRIOR
from cdff_core.dfns.pose_graph_optimization.interface import (
    PoseGraphOptimizationInputs,
    PoseGraphOptimizationOutputs,
)
from cdff_core.map_merging.robot_maps import Closure, Float, KeyframeId, RobotMap

#: Number of ids reserved for each robot: the vertices of robot i in the joint graph start at i times this.
ROBOT_IDS = 1_000_000
SITE = "site"
PRODUCER = "map_merging"
#: Minimum standard deviation of an edge, so that its covariance can be inverted.
_MIN_SIGMA = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class MergedMaps:
    """Result of the optimisation of the joint graph."""

    graph: PoseGraph  # keyframes of all robots in the site, without the rejected closures
    anchors: Mapping[str, UncertainTransform]  # ``T_site_map`` of each robot
    #: Largest displacement of a keyframe of each robot that its anchor, a rigid transform, does not describe.
    deformation_m: Mapping[str, float]
    rejected: tuple[Closure, ...]  # closures that contradict the other edges


class MapMerger:
    """Optimises the joint graph: edges of each robot's map, surveyed pose of each map, closures between maps.

    The order of the names of all robots of the mission determines the ids in the graph.
    """

    def __init__(self, config: MergingConfig, robots: Sequence[str]) -> None:
        self._first_id = first_ids(robots)
        self._optimise: Dfn[Any, PoseGraphOptimizationInputs, PoseGraphOptimizationOutputs] = (
            Registry.default().make_dfn("pose_graph_optimization", "ChordalGaussNewton")
        )
        self._optimise.configure(config.optimise)

    def merge(self, maps: Sequence[RobotMap], closures: Sequence[Closure]) -> MergedMaps:
        """Optimise the joint graph; a map without a closure to another map keeps its surveyed pose."""
        ids = {
            keyframe: self._first_id[m.robot] + row for m in maps for row, keyframe in enumerate(m.keyframes)
        }
        linking_closures = [c for c in closures if c.first in ids and c.second in ids]
        graph = _joint_graph(maps, linking_closures, ids)
        roots = np.array([self._first_id[m.robot] + m.root for m in maps], dtype=np.int64)
        solution = self._optimise.process(PoseGraphOptimizationInputs(graph=graph, wanted=roots))
        is_accepted = solution.weights > 0.5
        optimised_poses = dict(
            zip(solution.graph.vertices.ids.tolist(), solution.graph.vertices.matrices, strict=True)
        )
        anchors, deformation_m = {}, {}
        for m, root, covariance in zip(maps, roots.tolist(), solution.covariances, strict=True):
            in_map = np.array(list(m.keyframes.values()))
            in_site = np.array([optimised_poses[ids[keyframe]] for keyframe in m.keyframes])
            T = fit_rigid_transform(in_site, in_map)
            deformation_m[m.robot] = float(np.linalg.norm((T @ in_map - in_site)[:, :3, 3], axis=1).max())
            T_map_root = UncertainTransform.exact(m.graph.vertices.matrices[m.root])
            at_root = UncertainTransform(optimised_poses[root], covariance)
            anchors[m.robot] = UncertainTransform(T, (at_root @ T_map_root.inverse()).covariance)
        rejected = tuple(
            c
            for c, ok in zip(
                linking_closures, is_accepted[len(is_accepted) - len(linking_closures) :], strict=True
            )
            if not ok
        )
        return MergedMaps(_with_edges(solution.graph, is_accepted), anchors, deformation_m, rejected)


def first_ids(robots: Sequence[str]) -> dict[str, int]:
    """Return the first id of each robot's vertices in the joint graph."""
    return {robot: ROBOT_IDS * number for number, robot in enumerate(sorted(robots))}


def fit_rigid_transform(in_parent: Float, in_child: Float) -> Float:
    """Return ``T_parent_child`` from the same poses in both frames, (n, 4, 4) each.

    It is the mean rotation and, with this rotation, the mean translation.
    """
    R = se3.normalise_rotation((in_parent[:, :3, :3] @ np.swapaxes(in_child[:, :3, :3], 1, 2)).mean(axis=0))
    translation = (in_parent[:, :3, 3] - in_child[:, :3, 3] @ R.T).mean(axis=0)
    return se3.transform(R, translation)


def closures_in_graph(graph: PoseGraph, robots: Sequence[str]) -> list[Closure]:
    """Return the closures between different robots in a joint graph."""
    names = {first: robot for robot, first in first_ids(robots).items()}
    keyframe = {
        i: KeyframeId(names[i - i % ROBOT_IDS], t)
        for i, t in zip(graph.vertices.ids.tolist(), graph.vertices.stamps_ns.tolist(), strict=True)
        if i - i % ROBOT_IDS in names
    }
    e = graph.edges
    rows = zip(e.ends.tolist(), e.matrices, e.information_matrices, strict=True)
    return [
        Closure(keyframe[a], keyframe[b], UncertainTransform(T, np.linalg.inv(information)))
        for (a, b), T, information in rows
        if a in keyframe and b in keyframe and keyframe[a].robot != keyframe[b].robot
    ]


def _joint_graph(
    maps: Sequence[RobotMap], closures: Sequence[Closure], ids: Mapping[KeyframeId, int]
) -> PoseGraph:
    """Return the graph of all maps: their vertices and edges, a prior on each root, then the closures."""
    edge_ends, Ts, information, kinds = [], [], [], []
    for m in maps:
        ids_of_map = [ids[keyframe] for keyframe in m.keyframes]
        joint_ids = dict(zip(m.graph.vertices.ids.tolist(), ids_of_map, strict=True))
        e = m.graph.edges
        edge_ends += [(joint_ids[a], joint_ids[b]) for a, b in e.ends.tolist()]
        Ts += list(e.matrices)
        information += list(e.information_matrices)
        kinds += e.kinds.tolist()
        root = ids_of_map[m.root]
        T_site_root = m.survey @ UncertainTransform.exact(m.graph.vertices.matrices[m.root])
        edge_ends.append((root, root))
        Ts.append(T_site_root.matrix)
        information.append(_information(T_site_root))
        kinds.append(PRIOR)
    for closure in closures:
        edge_ends.append((ids[closure.first], ids[closure.second]))
        Ts.append(closure.T.matrix)
        information.append(_information(closure.T))
        kinds.append(LOOP_CLOSURE)
    start = [m.anchor.matrix @ T for m in maps for T in m.keyframes.values()]
    return PoseGraph.from_arrays(
        list(ids.values()),
        [keyframe.stamp_ns for keyframe in ids],
        np.array([se3.normalise_transform(T) for T in start]),
        np.array(edge_ends),
        np.array([se3.normalise_transform(T) for T in Ts]),
        np.array(information),
        kinds,
        frame=SITE,
        producer=PRODUCER,
    )


def _with_edges(graph: PoseGraph, is_accepted: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> PoseGraph:
    """Return the graph with the edges of a mask only."""
    v, e = graph.vertices, graph.edges
    return PoseGraph.from_arrays(
        v.ids,
        v.stamps_ns,
        v.matrices,
        e.ends[is_accepted],
        e.matrices[is_accepted],
        e.information_matrices[is_accepted],
        e.kinds[is_accepted],
        frame=graph.frame,
        fixed=v.fixed,
        producer=PRODUCER,
    )


def _information(T: UncertainTransform) -> Float:
    covariance = np.zeros((6, 6)) if T.covariance is None else T.covariance
    return information_from_covariance(covariance, _MIN_SIGMA)
