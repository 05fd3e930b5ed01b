# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import hashlib
from dataclasses import replace

import numpy as np
import pytest
import zstandard

from cdff_common.clock import ManualClock
from cdff_common.contract.limits import LATEST_NS
from cdff_common.errors import CodecError, ConflictError, InputError, ProductNotFoundError, StorageError
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from dpm_store import Insertion, Query, Store
from dpm_store.payloads.blobs import CHUNK_BYTES
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support.postgresql import ONLY_FILES
from tests.support.store_products import NAMES, header, put

SIZES = [0, 1, PACKED_BYTES, PACKED_BYTES + 1, CHUNK_BYTES, 2 * CHUNK_BYTES + 17]


@pytest.mark.parametrize("size", SIZES)
def test_an_inserted_product_is_retrieved_completely(store: Store, size: int) -> None:
    payload = bytes(i % 251 for i in range(size))
    quality = Quality(Status.DEGRADED, ("few_points",), CovarianceKind.FORMAL, {"points": 12.0})
    original = header(
        3, box_m=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0), resolution_m=0.1, inputs=("a", "b"), quality=quality
    )
    assert put(store, original, payload) is Insertion.INSERTED
    record = store.get(original.id)
    assert record.header == replace(original, sha256=hashlib.sha256(payload).hexdigest())
    assert (record.robot, record.product, record.type_name, record.codec) == (
        "mana",
        "dem",
        "ElevationMap",
        "uper",
    )
    assert record.size == size
    assert store.payload(original.id) == payload


@pytest.mark.parametrize(
    ("offset", "length"),
    [(0, 1), (CHUNK_BYTES - 1, 2), (CHUNK_BYTES, CHUNK_BYTES), (5, None), (2 * CHUNK_BYTES + 17, 4), (7, 0)],
)
def test_any_part_of_a_payload_can_be_read(store: Store, offset: int, length: int | None) -> None:
    payload = bytes(i % 253 for i in range(2 * CHUNK_BYTES + 17))
    put(store, header(0), payload)
    expected = payload[offset:] if length is None else payload[offset : offset + length]
    assert store.payload(header(0).id, offset, length) == expected


def test_a_range_beyond_the_end_is_refused(store: Store) -> None:
    put(store, header(0), b"abc")
    with pytest.raises(InputError, match="offset 4"):
        store.payload(header(0).id, 4)


def test_a_repeated_insertion_of_equal_content_changes_nothing(store: Store) -> None:
    put(store, header(1), b"same")
    assert put(store, header(1), b"same") is Insertion.ALREADY
    assert store.statistics().count == 1
    assert len(store.events.since()) == 1


@pytest.mark.parametrize("change", ["payload", "robot", "quality", "codec"])
def test_the_same_id_with_other_content_is_a_conflict(store: Store, change: str) -> None:
    put(store, header(1), b"same")
    other = header(1, quality=Quality(Status.DEGRADED)) if change == "quality" else header(1)
    with pytest.raises(ConflictError, match="other content"):
        put(
            store,
            other,
            b"else" if change == "payload" else b"same",
            **(NAMES | ({"robot": "minnie"} if change == "robot" else {})),
            codec="ber" if change == "codec" else "uper",
        )
    assert store.payload(header(1).id) == b"same"


def test_a_payload_with_another_digest_than_its_header_is_refused(store: Store) -> None:
    with pytest.raises(CodecError, match="SHA-256"):
        put(store, replace(header(0), sha256="0" * 64), b"abc")
    assert store.statistics().count == 0


@pytest.mark.parametrize(
    "names",
    [
        {"robot": "../etc"},
        {"robot": ""},
        {"dfpc": "Upper"},
        {"port": "a/b"},
        {"product": "x" * 65},
        {"type_name": "1"},
        {"codec": "zip"},
    ],
)
def test_malformed_names_are_refused(store: Store, names: dict[str, str]) -> None:
    with pytest.raises(InputError):
        put(store, header(0), b"abc", **names)


@pytest.mark.parametrize(
    "box", [(0, 0, 0, float("nan"), 1, 1), (0, 0, 0, float("inf"), 1, 1), (1, 0, 0, 0, 1, 1)]
)
def test_invalid_boxes_are_refused(store: Store, box: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="box_m"):
        put(store, header(0, box_m=box), b"abc")
    assert store.statistics().count == 0


def test_a_deleted_product_is_not_found_and_its_id_cannot_be_used_again(
    store: Store, clock: ManualClock
) -> None:
    put(store, header(0, box_m=(0, 0, 0, 1, 1, 1)), b"abc")
    assert store.delete(header(0).id) is True
    assert store.delete(header(0).id) is False
    for read in (store.get, store.payload):
        with pytest.raises(ProductNotFoundError):
            read(header(0).id)
    assert store.get(header(0).id, deleted=True).deleted_ns == clock.now_ns()
    assert store.search(Query()).items == ()
    with pytest.raises(ConflictError, match="deleted"):
        put(store, header(0, box_m=(0, 0, 0, 1, 1, 1)), b"abc")
    assert [e.kind for e in store.events.since()] == ["inserted", "deleted"]


def test_unknown_ids_are_not_found(store: Store) -> None:
    for read in (store.get, store.payload, store.delete):
        with pytest.raises(ProductNotFoundError):
            read("../../etc/passwd")


@ONLY_FILES
def test_equal_payloads_are_stored_once(store: Store) -> None:
    payload = b"x" * (PACKED_BYTES + 1)
    put(store, header(0), payload)
    put(store, header(1), payload)
    assert len([p for p in (store.directory / "blobs").glob("??/*") if p.is_file()]) == 1
    store.delete(header(0).id)
    store.collect()
    assert store.payload(header(1).id) == payload


def test_collecting_frees_payloads_of_tombstones_only(store: Store) -> None:
    large = np.random.default_rng(1).bytes(PACKED_BYTES + 1)
    for seq, payload in enumerate((bytes(10), large)):
        put(store, header(seq), payload)
        store.delete(header(seq).id)
    assert store.collect() == 10 + PACKED_BYTES + 1
    assert store.collect() == 0
    assert store.verify() == ()
    assert put(store, header(7), large) is Insertion.INSERTED
    assert store.payload(header(7).id) == large


@ONLY_FILES
def test_a_compressible_payload_needs_less_space_and_any_part_can_be_read(store: Store) -> None:
    heights = np.full((3, CHUNK_BYTES // 8), np.nan)
    heights[1, ::9] = np.arange(len(heights[1, ::9]))
    payload = heights.tobytes()[:-5]
    put(store, header(0), payload)
    (path,) = (store.directory / "blobs").glob("??/*")
    assert path.stat().st_size < len(payload) / 5
    with path.open("rb") as file:
        reader = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        assert reader.readall() == payload
    for offset, length in ((0, 10), (CHUNK_BYTES - 1, 2), (CHUNK_BYTES, CHUNK_BYTES), (len(payload) - 3, 3)):
        assert store.payload(header(0).id, offset, length) == payload[offset : offset + length]
    assert store.payload(header(0).id) == payload
    assert store.verify() == ()
    store.delete(header(0).id)
    assert store.collect() < len(payload) / 5


@ONLY_FILES
@pytest.mark.parametrize("size", [100, PACKED_BYTES + 100, 3 * CHUNK_BYTES])
@pytest.mark.parametrize("levels", [256, 4], ids=["stored", "compressed"])
def test_a_flipped_bit_is_detected_and_the_payload_is_never_returned(
    store: Store, size: int, levels: int
) -> None:
    payload = np.random.default_rng(2).integers(0, levels, size, np.uint8).tobytes()
    put(store, header(0), payload)
    sha256 = store.get(header(0).id).sha256
    path = store.directory / "blobs" / sha256[:2] / sha256[2:]
    path = path if size > PACKED_BYTES else store.directory / "packs" / "00000001.pack"
    data = bytearray(path.read_bytes())
    data[min(size, len(data)) // 2] ^= 0x10
    path.write_bytes(data)
    with pytest.raises(StorageError, match="corrupt on the disk"):
        store.payload(header(0).id)
    assert [p.where for p in store.verify()] == [f"payload {sha256}"]
    if size == 3 * CHUNK_BYTES:
        assert store.payload(header(0).id, 0, 100) == payload[:100]


@ONLY_FILES
def test_a_truncated_or_missing_file_is_reported(store: Store) -> None:
    put(store, header(0), b"y" * (PACKED_BYTES + 5))
    sha256 = store.get(header(0).id).sha256
    path = store.directory / "blobs" / sha256[:2] / sha256[2:]
    stored = path.read_bytes()
    for damaged in (b"", b"y" * 10, stored[:-1], stored[1:], stored + b"\0"):
        path.write_bytes(damaged)
        with pytest.raises(
            StorageError, match=f"payload file of {len(damaged)} bytes is corrupt on the disk"
        ):
            store.payload(header(0).id)
    path.unlink()
    with pytest.raises(StorageError, match="not readable"):
        store.payload(header(0).id)


def test_provenance_and_events_are_in_the_same_commit(store: Store) -> None:
    put(store, header(0, inputs=("a", "a", "b")), b"abc")
    (event,) = store.events.since()
    assert (event.kind, event.scope, event.body["id"]) == ("inserted", "mana", header(0).id)
    with store._database.read() as connection:
        rows = connection.exec_driver_sql("SELECT input_id FROM provenance ORDER BY 1").scalars().all()
    assert rows == ["a", "b"]


def test_history_and_revisions_cannot_be_changed(store: Store) -> None:
    put(store, header(0), b"abc")
    for statement in ("DELETE FROM events", "UPDATE events SET kind = 'x'"):
        with pytest.raises(StorageError, match="append-only"), store._database.write() as connection:
            connection.exec_driver_sql(statement)
    assert len(store.events.since()) == 1


def test_statistics_count_by_robot_and_type(store: Store) -> None:
    put(store, header(0), b"abc")
    put(store, header(1), b"abcd", robot="minnie", product="pointcloud", type_name="Pointcloud")
    s = store.statistics()
    assert s.products == {("mana", "dem"): 1, ("minnie", "pointcloud"): 1}
    assert (s.payload_bytes, s.newest_t1_ns) == (7, header(1).t1_ns)


def test_the_box_of_a_product_may_be_a_point(store: Store) -> None:
    put(store, replace(header(0), box_m=(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)), b"abc")
    assert store.get(header(0).id).header.box_m == (1.0,) * 6


def test_sequence_numbers_up_to_the_latest_time_are_stored(store: Store) -> None:
    for number in (0, LATEST_NS):
        put(store, header(number, t1_ns=1000))
    assert {record.header.seq for record in store.search(Query()).items} == {0, LATEST_NS}


@pytest.mark.parametrize("number", [-1, LATEST_NS + 1])
def test_sequence_numbers_out_of_range_are_refused(store: Store, number: int) -> None:
    with pytest.raises(InputError, match="seq"):
        put(store, header(number, t1_ns=1000))
