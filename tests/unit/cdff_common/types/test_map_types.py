# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graphs, landmark maps, key frames, meshes, detections, tracks, product metadata: made, checked, read."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import CODECS, decode, encode
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status

_S = 1_000_000_000


def _moved(*xyz: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = xyz
    return T


def _graph(**changes: Any) -> types.PoseGraph:
    parts: dict[str, Any] = {
        "ids": [7, 9], "stamps_ns": [_S, 2 * _S], "matrices": [_moved(0, 0, 0), _moved(1, 2, 3)], "ends": [[7, 9]],
        "edge_matrices": [_moved(1, 2, 3)], "information": [np.diag(np.arange(1.0, 7.0))], "kinds": [0],
        "frame": "mana/odom", "fixed": [True, False],
    }  # fmt: skip
    return types.PoseGraph.from_arrays(**(parts | changes))


def test_a_pose_graph_keeps_its_matrices_in_every_codec() -> None:
    graph = _graph()
    for codec in CODECS:
        found = decode("PoseGraph", encode(graph, codec), codec)
        assert found == graph
        np.testing.assert_allclose(found.vertices.matrices[1], _moved(1, 2, 3))
        np.testing.assert_array_equal(found.edges.information_matrices[0], np.diag(np.arange(1.0, 7.0)))
    assert (graph.frame, graph.stamp_ns) == ("mana/odom", 2 * _S)
    assert graph.vertices.stamps_ns.tolist() == [_S, 2 * _S]
    assert graph.vertices.fixed.tolist() == [1, 0]
    assert graph.extent_m() == (0.0, 0.0, 0.0, 1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ends": [[7, 8]]}, "vertex 8 is not in the graph"),
        ({"ids": [7, 7]}, "an id is there twice"),
        ({"stamps_ns": [_S]}, "stamps: 1 rows, expected 2"),
        ({"stamps_ns": [_S, 2 * _S + 1]}, "multiples of 1000 ns"),
        ({"fixed": [True]}, "fixed: 1 rows, expected 2, or none"),
        ({"kinds": []}, "kinds: 0 rows, expected 1"),
        ({"information": [np.eye(3)]}, r"shape \(1, 3, 3\), expected \(1, 6, 6\)"),
        ({"matrices": [_moved(0, 0, 0), 2 * np.eye(4)]}, "matrix 1: .* expected a rigid transform"),
    ],
)
def test_a_pose_graph_that_does_not_fit_together_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        _graph(**changes)


def test_a_landmark_map_holds_descriptors_by_row() -> None:
    descriptors = np.arange(64, dtype=np.uint8).reshape(2, 32)
    found = types.LandmarkMap.from_arrays(
        [4, 5], [[0, 0, 1], [1, 0, 3]], frame="site", stamp_ns=_S, covariances=[np.eye(3), np.full((3, 3), np.nan)],
        observations=[3, 1], descriptors=descriptors, descriptor_type="ORB",
    )  # fmt: skip
    back = decode("LandmarkMap", encode(found))
    np.testing.assert_array_equal(back.descriptors, descriptors)
    np.testing.assert_array_equal(back.covariances[0], np.eye(3))
    assert back.extent_m() == (0.0, 0.0, 1.0, 1.0, 0.0, 3.0)
    assert (back.frame, back.stamp_ns) == ("site", _S)
    with pytest.raises(InputError, match="descriptors: 2 rows, expected 1, or none"):
        types.LandmarkMap.from_arrays([4], [[0, 0, 1]], frame="site", stamp_ns=_S, descriptors=descriptors)
    bare = types.LandmarkMap.from_arrays([4], [[0, 0, 1]], frame="site", stamp_ns=_S)
    assert bare.descriptors is None
    assert bare.covariances is None


def test_a_key_frame_lies_where_its_camera_was() -> None:
    pose = types.TransformWithCovariance.from_transform(
        UncertainTransform(_moved(1, 2, 3)), parent="site", child="mana/navcam_left", stamp_ns=_S
    )
    frame = types.KeyFrame.from_arrays(3, pose, [[10.5, 20.0]], stamp_ns=_S, landmarks=[-1], scales_px=[31.0])
    back = decode("KeyFrame", encode(frame, "msgpack"), "msgpack")
    assert back == frame
    assert back.extent_m() == (1.0, 2.0, 3.0, 1.0, 2.0, 3.0)
    assert back.stamp_ns == _S
    assert back.descriptors is None
    with pytest.raises(InputError, match="landmarks: 2 rows, expected 1"):
        types.KeyFrame.from_arrays(3, pose, [[10.5, 20.0]], stamp_ns=_S, landmarks=[1, 2])


SQUARE, HOLE = [[0, 0], [4, 0], [4, 3], [0, 3]], [[1, 1], [1, 2], [2, 1]]


def _areas(**changes: Any) -> types.GroundAreas:
    parts: dict[str, Any] = {
        "kinds": [3, 1], "ring_counts": [2, 1], "corner_counts": [4, 3, 4], "corners_m": SQUARE + HOLE + SQUARE,
        "frame": "site", "t0_ns": _S, "t1_ns": 2 * _S,
    }  # fmt: skip
    return types.GroundAreas.from_rings(**(parts | changes))


def test_areas_of_the_ground_keep_their_rings_and_know_their_size_in_every_codec() -> None:
    areas = _areas()
    for codec in CODECS:
        found = decode("GroundAreas", encode(areas, codec), codec)
        assert found == areas
        assert [[ring.tolist() for ring in rings] for rings in found.polygons] == [[SQUARE, HOLE], [SQUARE]]
    assert areas.data.areas.tolist() == [11.5, 12.0]
    assert (areas.frame, areas.t0_ns, areas.stamp_ns) == ("site", _S, 2 * _S)
    assert areas.extent_m() == (0.0, 0.0, 0.0, 4.0, 3.0, 0.0)
    none = _areas(kinds=[], ring_counts=[], corner_counts=[], corners_m=[])
    assert (none.polygons, none.extent_m()) == ([], None)
    far = _areas(corners_m=np.array(SQUARE + HOLE + SQUARE) + 1e9)
    assert far.data.areas.tolist() == [11.5, 12.0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kinds": [3, 6]}, "kinds: 6, expected 0 to 5"),
        ({"kinds": [3]}, "areas: 2 rows, expected 1"),
        ({"ring_counts": [3, 0]}, "ring_counts: 0, expected 1 at least"),
        ({"ring_counts": [2, 2]}, "corner_counts: 3 rows, expected 4"),
        ({"corner_counts": [5, 2, 4]}, "corner_counts: 2, expected 3 at least"),
        ({"corner_counts": [4, 3, 5]}, "corners: 11 rows, expected 12"),
    ],
)
def test_areas_whose_rings_do_not_fit_together_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        _areas(**changes)


def test_a_mesh_joins_vertices_that_are_there() -> None:
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    mesh = types.Mesh.from_arrays(vertices, [[0, 1, 2]], frame="site", stamp_ns=_S, colors=[[255, 0, 0]] * 3)
    assert decode("Mesh", encode(mesh)) == mesh
    assert mesh.extent_m() == (0.0, 0.0, 0.0, 1.0, 1.0, 0.0)
    assert (mesh.frame, mesh.stamp_ns) == ("site", _S)
    with pytest.raises(InputError, match="triangles: vertex 3, expected below 3"):
        types.Mesh.from_arrays(vertices, [[0, 1, 3]], frame="site", stamp_ns=_S)


def test_tracks_and_detections_have_time_and_place() -> None:
    track = types.ObjectTrack.from_arrays(
        5, [_S, 2 * _S], [_moved(0, 0, 0), _moved(2, 0, 0)], frame="site", label="rock", status=1, score=0.5,
        velocities=np.ones((2, 6)), covariances=[np.eye(6)] * 2, size_m=(1, 1, 1),
    )  # fmt: skip
    assert decode("ObjectTrack", encode(track, "xer"), "xer") == track
    assert (track.stamp_ns, track.frame, track.stamps_ns.tolist()) == (2 * _S, "site", [_S, 2 * _S])
    assert track.extent_m() == (0.0, 0.0, 0.0, 2.0, 0.0, 0.0)
    assert track.metadata.status is types.ObjectTrackStatusT.TRACK_CONFIRMED
    with pytest.raises(InputError, match="expected rising stamps"):
        types.ObjectTrack.from_arrays(5, [_S, _S], [np.eye(4)] * 2, frame="site")
    seen = types.ObjectDetection(
        "rock", 0.5, types.TransformWithCovariance.from_transform(
            UncertainTransform(_moved(1, 0, 5)), parent="mana/navcam_left", child="rock", stamp_ns=_S)
    )  # fmt: skip
    detections = types.ObjectDetections(
        time_stamp=types.Time.from_ns(_S), detections=(seen, types.ObjectDetection("in the image only"))
    )
    assert detections.stamp_ns == _S
    assert detections.extent_m() == (1.0, 0.0, 5.0, 1.0, 0.0, 5.0)


def test_metadata_of_a_product_give_its_header_back() -> None:
    header = Header(
        id="00000000-0000-5000-8000-000000000001", seq=4, t0_ns=_S, t1_ns=2 * _S, frame="site", child="mana/base",
        producer="position_manager/ekf/1", config_hash="abc", inputs=("a", "b"), box_m=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0),
        quality=Quality(Status.DEGRADED, ("few",), CovarianceKind.FORMAL, {"rmse_m": 0.5}), resolution_m=0.1,
        sha256="ff",
    )  # fmt: skip
    metadata = types.ProductMetadata.from_header(
        header, robot="mana", dfpc="d", port="p", product="pose", encoding="application/vnd.cdff+uper;Pose/1", size=9
    )
    assert decode("Product-Metadata", encode(metadata)).header == header
    assert metadata.stamp_ns == 2 * _S
    assert metadata.extent_m() == header.box_m
    bare = Header(id=header.id, seq=0, t0_ns=0, t1_ns=0, frame="site", producer="x")
    assert types.ProductMetadata.from_header(
        bare, robot="", dfpc="", port="", product="", encoding="", size=0
    ).header == bare  # fmt: skip


@pytest.mark.parametrize("name", ["IcuMode", "DfpcStatus", "Event", "Og2Job", "Og2Reply"])
def test_what_the_system_says_of_itself_has_a_time(name: str) -> None:
    value = getattr(types, name)(time_stamp=types.Time.from_ns(_S))
    assert value.stamp_ns == _S
