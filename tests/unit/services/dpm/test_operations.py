# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from cdff_common.codecs import decode, encode, encoding_string
from cdff_common.contract.queries import (
    DeliveryParameters,
    NavigationWindowParameters,
    NewestParameters,
    ProfileParameters,
    SearchParameters,
    WindowParameters,
)
from cdff_common.errors import CodecError, InputError, ProductNotFoundError, UnavailableError
from cdff_common.geometry.frame_graph import EXTRAPOLATION_LIMIT_NS
from cdff_common.interfaces.product import Header, Quality, Status
from cdff_common.types import Pointcloud
from dpm_store import Event, Insertion, Query
from dpm_store.frames.frames import HistoryView
from services.dpm.operations import retrieval
from services.dpm.operations.dpm import Dpm

from .conftest import S, cloud, elevation, navigation, pose, put_arguments


def test_an_insertion_is_published_once(dpm: Dpm) -> None:
    received: list[Event] = []
    dpm.events.listen(received.append)
    names, payload, encoding, attachment = put_arguments(cloud(), "pointcloud")
    assert dpm.writer.put(names, payload, encoding, attachment)[0] is Insertion.INSERTED
    assert dpm.writer.put(names, payload, encoding, attachment)[0] is Insertion.ALREADY
    assert [(e.kind, e.body["product"]) for e in received] == [("inserted", "pointcloud")]
    assert dpm.events.counters["inserted"] == dpm.events.counters["already"] == 1


def test_a_missing_box_is_computed_from_the_value(dpm: Dpm) -> None:
    _, header = dpm.writer.put(*put_arguments(cloud(), "pointcloud"))
    points = cloud().points_m
    box_m = dpm.store.get(header.id).header.box_m
    assert box_m == pytest.approx([*points.min(axis=0), *points.max(axis=0)], abs=1e-6)


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        ({"attachment": b"\x00"}, CodecError, "map"),
        ({"attachment": b""}, CodecError, "MessagePack"),
        ({"encoding": "text/plain"}, CodecError, "encoding"),
        ({"encoding": "application/vnd.cdff+uper;Pointcloud/9"}, CodecError, "version"),
        ({"encoding": "application/vnd.cdff+uper;ElevationMap/1"}, InputError, "stored as Pointcloud"),
        ({"payload": b"\xff" * 40}, CodecError, "Pointcloud"),
        ({"payload": b""}, InputError, "FAILED"),
        ({"payload": b"x" * (1 << 20) + b"x"}, InputError, "at most"),
        ({"product": "nonsense"}, InputError, "expected one of"),
        ({"robot": "../../etc"}, InputError, "robot"),
    ],
)
def test_unreadable_products_are_refused_and_not_stored(
    dpm: Dpm, change: dict, error: type, match: str
) -> None:
    names, payload, encoding, attachment = put_arguments(cloud(), "pointcloud")
    names |= {k: v for k, v in change.items() if k in names}
    with pytest.raises(error, match=match):
        dpm.writer.put(
            names,
            change.get("payload", payload),
            change.get("encoding", encoding),
            change.get("attachment", attachment),
        )
    assert dpm.store.statistics().count == 0
    assert dpm.events.counters["refused"] == 1


def test_a_pose_that_contradicts_its_header_is_refused(dpm: Dpm) -> None:
    with pytest.raises(CodecError, match="its header"):
        dpm.writer.put(*put_arguments(pose(0, 1.0), "pose", child="minnie/base"))


def test_a_failed_result_is_stored_without_value_and_is_not_the_newest(dpm: Dpm) -> None:
    _, good = dpm.writer.put(*put_arguments(cloud(), "pointcloud", 0))
    names, _, encoding, attachment = put_arguments(
        cloud(), "pointcloud", 1, quality=Quality(Status.FAILED, ("black",))
    )
    _, failed = dpm.writer.put(names, b"", encoding, attachment)
    assert [r.id for r in dpm.retrieval.find(Query()).items] == [failed.id, good.id]
    assert dpm.retrieval.newest(NewestParameters(type=("pointcloud",))).metadata["id"] == good.id
    with pytest.raises(InputError, match="FAILED"):
        dpm.retrieval.product(failed.id, DeliveryParameters(format="ply"))


def test_the_newest_product_is_found_behind_many_failed_ones(dpm: Dpm) -> None:
    _, good = dpm.writer.put(*put_arguments(cloud(), "pointcloud", 0))
    for t_s in range(1, 6):
        quality = Quality(Status.FAILED, ("black",))
        names, _, encoding, attachment = put_arguments(cloud(), "pointcloud", t_s, quality=quality)
        dpm.writer.put(names, b"", encoding, attachment)
    newest = dpm.retrieval.newest(NewestParameters.parse({"type": "pointcloud", "limit": "1"}))
    assert newest.metadata["id"] == good.id
    assert newest.body.data


def test_a_newest_product_that_the_client_holds_is_not_delivered_again(dpm: Dpm) -> None:
    _, first = dpm.writer.put(*put_arguments(cloud(), "pointcloud", 0))
    parameters = NewestParameters.parse({"type": "pointcloud", "known": first.id})
    unchanged = dpm.retrieval.newest(parameters)
    assert (unchanged.reference, unchanged.body.data) == (first.id, b"")
    _, second = dpm.writer.put(*put_arguments(cloud(), "pointcloud", 1))
    changed = dpm.retrieval.newest(parameters)
    assert changed.reference is None
    assert changed.metadata["id"] == second.id
    assert changed.body.data


def test_a_window_fuses_patches_and_names_them(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    dpm.writer.put(*put_arguments(elevation(1.0, 2.0), "dem", 2, robot="minnie", resolution_m=0.1))
    answer = dpm.retrieval.window(WindowParameters.parse({"region": "bbox:0,0,4,2"}))
    value = decode("ElevationMap", answer.body.data, "uper")
    mean = value.layer("mean")
    assert mean.shape == (20, 40)
    assert mean[5, 5] == pytest.approx(1.0)
    assert mean[5, 15] == pytest.approx(1.5)
    assert mean[5, 25] == pytest.approx(2.0)
    assert np.isnan(mean[5, 35])
    # Two patches with two points per cell, 1 m apart in height: the variance includes the difference.
    assert value.layer("variance")[5, 15] == pytest.approx(0.01 + 0.25)
    metadata = answer.metadata
    assert metadata["coverage"] == pytest.approx(0.75)
    assert metadata["robots"] == ("mana", "minnie")
    assert (metadata["oldest_ns"], metadata["newest_ns"], len(metadata["patches"])) == (1 * S, 2 * S, 2)
    assert tuple(metadata["inputs"]) == metadata["patches"]


def test_windows_and_profiles_are_counted(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    dpm.writer.put(*put_arguments(navigation(), "navigation_map", 2, resolution_m=0.1))
    region = {"region": "bbox:0,0,2,2"}
    dpm.retrieval.window(WindowParameters.parse(region))
    dpm.retrieval.elevation(WindowParameters.parse(region))
    dpm.retrieval.navigation(NavigationWindowParameters.parse(region))
    profile = dpm.retrieval.profile(ProfileParameters.parse({"path": "0.5,0.5,1.5,0.5", "step_m": "0.5"}))
    assert dpm.events.counters["windows"] == 4
    assert dpm.events.counters["gets"] == 0
    assert profile


def test_a_window_is_coarser_on_request_and_never_finer_than_its_patches(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    for requested, delivered in (("0.2", 0.2), ("0.05", 0.1), ("0.25", 0.2)):
        request = WindowParameters.parse({"region": "bbox:0,0,2,2", "resolution_m": requested})
        assert dpm.retrieval.window(request).metadata["resolution_m"] == pytest.approx(delivered)


def test_a_window_by_reference_is_stored_and_not_used_as_a_patch(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    request = WindowParameters.parse({"region": "bbox:0,0,2,2"})
    received: list[Event] = []
    dpm.events.listen(received.append)
    first = dpm.retrieval.window(request, DeliveryParameters(deliver="reference"))
    assert [(event.kind, event.body["id"]) for event in received] == [("inserted", first.reference)]
    repeated = dpm.retrieval.window(request, DeliveryParameters(deliver="reference"))
    assert first.reference == repeated.reference is not None
    stored = decode("ElevationMap", dpm.retrieval.product(str(first.reference)).body.data, "uper")
    assert stored.layer("count").max() == 2
    assert len(dpm.retrieval.window(request).metadata["patches"]) == 1


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"region": "bbox:50,50,51,51"}, ProductNotFoundError),
        ({"region": "bbox:0,0,2,2", "max_age_s": "98"}, ProductNotFoundError),
        ({"region": "bbox:0,0,2,2", "robot": "minnie"}, ProductNotFoundError),
        ({"region": "bbox:0,0,4,2", "min_coverage": "0.9"}, UnavailableError),
        ({"region": "bbox:-3000,-3000,3000,3000"}, InputError),
        ({"region": "circle:0,0,1e308"}, InputError),
        ({"region": "circle:1e300,0,1"}, ProductNotFoundError),
    ],
)
def test_a_window_that_cannot_satisfy_the_request_is_an_error(
    dpm: Dpm, parameters: dict[str, str], error: type
) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    with pytest.raises(error):
        dpm.retrieval.window(WindowParameters.parse(parameters))


def test_a_pose_is_returned_at_a_time_or_the_newest(dpm: Dpm) -> None:
    for second in (0, 2):
        dpm.writer.put(*put_arguments(pose(second, float(second)), "pose", second, child="mana/base"))
    assert dpm.frames.pose("site", "mana/base", 1 * S)["T"][0][3] == pytest.approx(1.0)
    newest = dpm.frames.pose("site", "mana/base", None)
    assert (newest["stamp_ns"], newest["T"][0][3]) == (2 * S, 2.0)


def test_the_answer_to_a_pose_query_names_its_frames_time_revision_and_limit(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(pose(2, 1.0), "pose", 2, child="mana/base"))
    answer = dpm.frames.pose("site", "mana/base", None, robot="mana", limit_s=0.5)
    assert {k: answer[k] for k in ("parent", "child", "robot", "stamp_ns", "limit_s")} == {
        "parent": "site",
        "child": "mana/base",
        "robot": "mana",
        "stamp_ns": 2 * S,
        "limit_s": 0.5,
    }
    assert answer["frames_revision"] == dpm.store.frames.state()
    assert dpm.frames.pose("site", "mana/base", 2 * S)["robot"] == ""
    assert dpm.frames.pose("site", "mana/base", 2 * S)["limit_s"] == EXTRAPOLATION_LIMIT_NS / 1e9


def test_the_answer_to_a_pose_query_of_an_earlier_state_names_that_state(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(pose(2, 1.0), "pose", 2, child="mana/base"))
    state = dpm.store.frames.state() + 7
    answer = dpm.frames.pose("site", "mana/base", None, view=HistoryView(state=state))
    assert answer["frames_revision"] == state


@pytest.mark.parametrize(("parent", "child"), [("no frame", "mana/base"), ("site", "no frame")])
def test_a_pose_query_with_an_invalid_frame_is_refused(dpm: Dpm, parent: str, child: str) -> None:
    with pytest.raises(InputError, match="no frame"):
        dpm.frames.pose(parent, child, None)


def test_a_pose_of_unmoved_frames_is_that_of_now(dpm: Dpm) -> None:
    assert dpm.frames.pose("site", "site", None)["stamp_ns"] == 100 * S


def test_a_window_with_exactly_the_required_coverage_is_delivered(dpm: Dpm) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    request = {"region": "bbox:0,0,4,2", "min_coverage": "0.5"}
    answer = dpm.retrieval.window(WindowParameters.parse(request))
    assert answer.metadata["coverage"] == 0.5
    assert (answer.metadata["frame"], answer.metadata["robot"]) == ("site", "mana")
    with pytest.raises(UnavailableError, match=r"coverage 0.500 of the region, asked 0.510"):
        dpm.retrieval.window(WindowParameters.parse(request | {"min_coverage": "0.51"}))


def test_a_product_is_stored_if_it_is_too_large_to_be_delivered_inline(
    dpm: Dpm, monkeypatch: pytest.MonkeyPatch
) -> None:
    dpm.writer.put(*put_arguments(elevation(0.0, 1.0), "dem", 1, resolution_m=0.1))
    request = WindowParameters.parse({"region": "bbox:0,0,2,2"})
    size = len(dpm.retrieval.window(request).body.data)
    monkeypatch.setattr(retrieval, "INLINE_BYTES", size)
    assert dpm.retrieval.window(request, DeliveryParameters(deliver="auto")).reference is None
    monkeypatch.setattr(retrieval, "INLINE_BYTES", size - 1)
    by_reference = dpm.retrieval.window(request, DeliveryParameters(deliver="auto"))
    assert by_reference.body.data == b""
    assert by_reference.reference == by_reference.metadata["id"]
    assert dpm.retrieval.window(request, DeliveryParameters(deliver="inline")).reference is None
    stored = dpm.store.get(str(by_reference.reference))
    assert (stored.robot, stored.product, stored.header.frame) == ("mana", "dem", "site")


def test_events_of_other_services_are_stored_and_published(dpm: Dpm) -> None:
    received: list[Event] = []
    dpm.events.listen(received.append)
    dpm.writer.record("mana", "activated", {"dfpc": "x"})
    dpm.events.unlisten(received.append)
    assert [(e.scope, e.kind) for e in dpm.store.events.since()] == [("mana", "activated")]
    assert [e.kind for e in received] == ["activated"]


@pytest.mark.parametrize(
    "fields", [{"t1_ns": 2**63 // 1000 * 1000}, {"t1_ns": -(2**63) // 1000 * 1000 + 1000}]
)
def test_times_out_of_range_are_refused(dpm: Dpm, fields: dict[str, int]) -> None:
    with pytest.raises(InputError, match=r"out of range|mission clock|expected 0"):
        dpm.writer.put(*put_arguments(cloud(), "pointcloud", 1, **fields))


def test_a_self_intersecting_polygon_is_refused() -> None:
    with pytest.raises(InputError, match="Self-intersection"):
        SearchParameters.parse({"region": "polygon:0,0,2,2,2,0,0,1"})


def test_a_cloud_of_the_larger_size_variant_is_stored_and_read_as_pointcloud(dpm: Dpm) -> None:
    large = Pointcloud.from_points(np.zeros((400_001, 3)), frame="site", stamp_ns=1_000_000_000)
    payload, encoding = encode(large, "uper"), encoding_string("PointcloudLarge", "uper")
    header = Header(
        id="00000000-0000-5000-8000-00000000000a",
        seq=0,
        t0_ns=10**9,
        t1_ns=10**9,
        frame="site",
        producer="test",
    )
    names = {"robot": "mana", "dfpc": "d", "port": "cloud", "product": "pointcloud"}
    dpm.writer.max_payload_bytes = 4 << 20
    dpm.writer.put(names, payload, encoding, header.to_attachment())
    assert dpm.retrieval.product(header.id).body.encoding == encoding
    answer = dpm.retrieval.product(header.id, DeliveryParameters(format="msgpack"))
    assert decode("PointcloudLarge", answer.body.data, "msgpack") == large
    assert dpm.retrieval.product(header.id, DeliveryParameters(format="ply")).body.suffix == "ply"
