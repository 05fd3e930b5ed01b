# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of maps: pose graphs, landmarks, keyframes, meshes, areas, tracks and product metadata."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import CODECS, decode, encode
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform

_S = 1_000_000_000


def _translation(*xyz: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = xyz
    return T


def _graph(**changes: Any) -> types.PoseGraph:
    fields: dict[str, Any] = {
        "ids": [7, 9],
        "stamps_ns": [_S, 2 * _S],
        "matrices": [_translation(0, 0, 0), _translation(1, 2, 3)],
        "ends": [[7, 9]],
        "edge_matrices": [_translation(1, 2, 3)],
        "information": [np.diag(np.arange(1.0, 7.0))],
        "kinds": [0],
        "frame": "mana/odom",
        "fixed": [True, False],
    }
    return types.PoseGraph.from_arrays(**(fields | changes))


def test_a_pose_graph_keeps_its_matrices_in_every_codec() -> None:
    graph = _graph()
    for codec in CODECS:
        decoded = decode("PoseGraph", encode(graph, codec), codec)
        assert decoded == graph
        np.testing.assert_allclose(decoded.vertices.matrices[1], _translation(1, 2, 3))
        np.testing.assert_array_equal(decoded.edges.information_matrices[0], np.diag(np.arange(1.0, 7.0)))
    assert (graph.frame, graph.stamp_ns) == ("mana/odom", 2 * _S)
    assert graph.vertices.stamps_ns.tolist() == [_S, 2 * _S]
    assert graph.vertices.fixed.tolist() == [1, 0]
    assert graph.extent_m() == (0.0, 0.0, 0.0, 1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ends": [[7, 8]]}, "vertex 8 is not in the graph"),
        ({"ids": [7, 7]}, "repeated id"),
        ({"stamps_ns": [_S]}, "stamps: 1 rows, expected 2"),
        ({"stamps_ns": [_S, 2 * _S + 1]}, "multiples of 1000 ns"),
        ({"fixed": [True]}, "fixed: 1 rows, expected 2, or none"),
        ({"kinds": []}, "kinds: 0 rows, expected 1"),
        ({"information": [np.eye(3)]}, r"shape \(1, 3, 3\), expected \(1, 6, 6\)"),
        ({"matrices": [_translation(0, 0, 0), 2 * np.eye(4)]}, "matrix 1: .* expected a rigid transform"),
    ],
)
def test_an_inconsistent_pose_graph_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        _graph(**changes)


def test_a_landmark_map_stores_descriptors_by_row() -> None:
    descriptors = np.arange(64, dtype=np.uint8).reshape(2, 32)
    landmarks = types.LandmarkMap.from_arrays(
        [4, 5],
        [[0, 0, 1], [1, 0, 3]],
        frame="site",
        stamp_ns=_S,
        covariances=[np.eye(3), np.full((3, 3), np.nan)],
        observations=[3, 1],
        descriptors=descriptors,
        descriptor_type="ORB",
    )
    decoded = decode("LandmarkMap", encode(landmarks))
    np.testing.assert_array_equal(decoded.descriptors, descriptors)
    np.testing.assert_array_equal(decoded.covariances[0], np.eye(3))
    assert decoded.extent_m() == (0.0, 0.0, 1.0, 1.0, 0.0, 3.0)
    assert (decoded.frame, decoded.stamp_ns) == ("site", _S)
    with pytest.raises(InputError, match="descriptors: 2 rows, expected 1, or none"):
        types.LandmarkMap.from_arrays([4], [[0, 0, 1]], frame="site", stamp_ns=_S, descriptors=descriptors)
    without_descriptors = types.LandmarkMap.from_arrays([4], [[0, 0, 1]], frame="site", stamp_ns=_S)
    assert without_descriptors.descriptors is None
    assert without_descriptors.covariances is None


def test_a_keyframe_has_the_pose_of_its_camera() -> None:
    pose = types.TransformWithCovariance.from_transform(
        UncertainTransform(_translation(1, 2, 3)), parent="site", child="mana/navcam_left", stamp_ns=_S
    )
    frame = types.KeyFrame.from_arrays(3, pose, [[10.5, 20.0]], stamp_ns=_S, landmarks=[-1], scales_px=[31.0])
    decoded = decode("KeyFrame", encode(frame, "msgpack"), "msgpack")
    assert decoded == frame
    assert decoded.extent_m() == (1.0, 2.0, 3.0, 1.0, 2.0, 3.0)
    assert decoded.stamp_ns == _S
    assert decoded.descriptors is None
    with pytest.raises(InputError, match="landmarks: 2 rows, expected 1"):
        types.KeyFrame.from_arrays(3, pose, [[10.5, 20.0]], stamp_ns=_S, landmarks=[1, 2])


SQUARE, HOLE = [[0, 0], [4, 0], [4, 3], [0, 3]], [[1, 1], [1, 2], [2, 1]]


def _areas(**changes: Any) -> types.GroundAreas:
    fields: dict[str, Any] = {
        "kinds": [3, 1],
        "ring_counts": [2, 1],
        "corner_counts": [4, 3, 4],
        "corners_m": SQUARE + HOLE + SQUARE,
        "frame": "site",
        "t0_ns": _S,
        "t1_ns": 2 * _S,
    }
    return types.GroundAreas.from_rings(**(fields | changes))


def test_ground_areas_keep_their_rings_and_size_in_every_codec() -> None:
    areas = _areas()
    for codec in CODECS:
        decoded = decode("GroundAreas", encode(areas, codec), codec)
        assert decoded == areas
        assert [[ring.tolist() for ring in rings] for rings in decoded.polygons] == [[SQUARE, HOLE], [SQUARE]]
    assert areas.data.areas.tolist() == [11.5, 12.0]
    assert (areas.frame, areas.t0_ns, areas.stamp_ns) == ("site", _S, 2 * _S)
    assert areas.extent_m() == (0.0, 0.0, 0.0, 4.0, 3.0, 0.0)
    empty = _areas(kinds=[], ring_counts=[], corner_counts=[], corners_m=[])
    assert (empty.polygons, empty.extent_m()) == ([], None)
    far = _areas(corners_m=np.array(SQUARE + HOLE + SQUARE) + 1e9)
    assert far.data.areas.tolist() == [11.5, 12.0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kinds": [3, 6]}, "kinds: 6, expected 0 to 5"),
        ({"kinds": [3]}, "areas: 2 rows, expected 1"),
        ({"ring_counts": [3, 0]}, "ring_counts: 0, expected at least 1"),
        ({"ring_counts": [2, 2]}, "corner_counts: 3 rows, expected 4"),
        ({"corner_counts": [5, 2, 4]}, "corner_counts: 2, expected at least 3"),
        ({"corner_counts": [4, 3, 5]}, "corners: 11 rows, expected 12"),
    ],
)
def test_areas_with_inconsistent_rings_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        _areas(**changes)


def test_a_mesh_refers_to_existing_vertices() -> None:
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    mesh = types.Mesh.from_arrays(vertices, [[0, 1, 2]], frame="site", stamp_ns=_S, colors=[[255, 0, 0]] * 3)
    assert decode("Mesh", encode(mesh)) == mesh
    assert mesh.extent_m() == (0.0, 0.0, 0.0, 1.0, 1.0, 0.0)
    assert (mesh.frame, mesh.stamp_ns) == ("site", _S)
    with pytest.raises(InputError, match="triangles: vertex 3, expected below 3"):
        types.Mesh.from_arrays(vertices, [[0, 1, 3]], frame="site", stamp_ns=_S)


def test_tracks_and_detections_have_stamp_and_position() -> None:
    track = types.ObjectTrack.from_arrays(
        5,
        [_S, 2 * _S],
        [_translation(0, 0, 0), _translation(2, 0, 0)],
        frame="site",
        label="rock",
        status=1,
        score=0.5,
        velocities=np.ones((2, 6)),
        covariances=[np.eye(6)] * 2,
        size_m=(1, 1, 1),
    )
    assert decode("ObjectTrack", encode(track, "xer"), "xer") == track
    assert (track.stamp_ns, track.frame, track.stamps_ns.tolist()) == (2 * _S, "site", [_S, 2 * _S])
    assert track.extent_m() == (0.0, 0.0, 0.0, 2.0, 0.0, 0.0)
    assert track.metadata.status is types.ObjectTrackStatusT.TRACK_CONFIRMED
    with pytest.raises(InputError, match="expected ascending stamps"):
        types.ObjectTrack.from_arrays(5, [_S, _S], [np.eye(4)] * 2, frame="site")
    detection = types.ObjectDetection(
        "rock",
        0.5,
        types.TransformWithCovariance.from_transform(
            UncertainTransform(_translation(1, 0, 5)), parent="mana/navcam_left", child="rock", stamp_ns=_S
        ),
    )
    detections = types.ObjectDetections(
        time_stamp=types.Time.from_ns(_S), detections=(detection, types.ObjectDetection("in the image only"))
    )
    assert detections.stamp_ns == _S
    assert detections.extent_m() == (1.0, 0.0, 5.0, 1.0, 0.0, 5.0)


def test_metadata_of_a_product_have_the_stated_box_and_the_end_of_capture() -> None:
    metadata = types.ProductMetadata(
        end_time=types.Time.from_ns(2 * _S), has_box=True, box=np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    )
    assert decode("Product-Metadata", encode(metadata)) == metadata
    assert metadata.stamp_ns == 2 * _S
    assert metadata.extent_m() == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    assert types.ProductMetadata().extent_m() is None


@pytest.mark.parametrize("name", ["IcuMode", "DfpcStatus", "Event", "Og2Job", "Og2Reply"])
def test_system_status_messages_have_a_stamp(name: str) -> None:
    value = getattr(types, name)(time_stamp=types.Time.from_ns(_S))
    assert value.stamp_ns == _S
