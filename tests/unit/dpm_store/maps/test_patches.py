# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of patches by their boxes, headers of products derived from others, and end of the readers."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status, product_id
from dpm_store.maps.patches import (
    DERIVED_DFPC,
    Patches,
    PatchSelection,
    bounds_each,
    bounds_in,
    bounds_of,
    derived_header,
    overlapping,
)
from dpm_store.products.records import ProductRecord
from tests.support.store_products import header

BOX = (1.0, 2.0, 0.0, 3.0, 5.0, 1.0)


def record(number: int, robot: str = "mana", size: int = 10, **fields: object) -> ProductRecord:
    """Return the record of a product whose header has other fields."""
    h: Header = replace(header(number), **fields)  # type: ignore[arg-type]
    packed = msgpack.packb(h.to_dict())
    return ProductRecord(
        ordinal=number, robot=robot, dfpc="mapper", port="map", product="dem", type_name="ElevationMap",
        codec="uper", id=h.id, t1_ns=h.t1_ns, packed_header=packed, size=size, inserted_ns=0, deleted_ns=None,
    )  # type: ignore[call-arg]  # fmt: skip


def test_boxes_that_touch_the_bounds_overlap_them() -> None:
    selection = PatchSelection(tuple(record(k) for k in range(6)), {})
    e = 1e-9
    boxes = np.array(
        [
            [4.0, 3.0, 5.0, 4.0], [4.0 + e, 3.0, 5.0, 4.0], [0.0, 0.0, 2.0, 9.0],
            [0.0, 0.0, 2.0 - e, 9.0], [3.0, 7.0, 3.5, 8.0], [3.0, 0.0, 3.5, 3.0 - e],
        ]
    )  # fmt: skip
    selected = overlapping(selection, boxes, (2.0, 3.0, 4.0, 7.0))
    assert [r.ordinal for r in selected.records] == [0, 2, 4]
    (touching,) = overlapping(replace(selection, records=selection.records[:1]), np.array([[3.0, 0, 3, 3]]),
                              (2.0, 3.0, 4.0, 7.0)).records  # fmt: skip
    assert touching.ordinal == 0


def test_bounds_are_those_of_the_boxes_in_the_frame_of_the_window() -> None:
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [10.0, 0.0, 0.0]))
    records = (
        record(0, box_m=BOX, frame="site"),
        record(1, box_m=BOX, frame="mana/map"),
        record(2, box_m=None),
    )
    selection = PatchSelection(records, {"mana/map": T})
    bounds = bounds_each(selection, "site")
    np.testing.assert_allclose(bounds[0], [1.0, 2.0, 3.0, 5.0])
    np.testing.assert_allclose(bounds[1], [5.0, 1.0, 8.0, 3.0])
    assert bounds[2].tolist() == [-np.inf, -np.inf, np.inf, np.inf]
    assert bounds_in(T, np.array(BOX)) == pytest.approx((5.0, 1.0, 8.0, 3.0))
    assert bounds_of(selection, "site") == pytest.approx((1.0, 1.0, 8.0, 5.0))
    with pytest.raises(InputError, match="no patch has a box"):
        bounds_of(replace(selection, records=records[2:]), "site")


def test_sizes_and_the_last_capture_of_a_selection() -> None:
    sizes = ((3, 5), (1, 7), (2, 2))
    selection = PatchSelection(tuple(record(k, size=s, t0_ns=0, t1_ns=k * 1000) for k, s in sizes), {})
    assert (selection.latest_ns, selection.largest_bytes, selection.total_bytes) == (3000, 7, 14)


def derived(*sources: ProductRecord, purged: int = 0, **fields: object) -> Header:
    arguments = {"contents": ["a", 1], "port": "window", "frame": "site", "producer": "dpm/1"} | fields
    return derived_header(sources, purged=purged, extent_m=BOX, **arguments)  # type: ignore[arg-type]


def test_a_derived_product_has_the_interval_and_inputs_of_its_sources() -> None:
    sources = (record(2, t0_ns=1000, t1_ns=3000), record(1, t0_ns=2000, t1_ns=4000))
    h = derived(*sources, resolution_m=0.1, covariance_kind=CovarianceKind.FORMAL, metrics={"a": 2.0})
    assert (h.t0_ns, h.t1_ns, h.seq) == (1000, 4000, 0)
    assert h.inputs == tuple(sorted(r.id for r in sources))
    assert (h.frame, h.producer, h.box_m, h.resolution_m) == ("site", "dpm/1", BOX, 0.1)
    assert h.quality == Quality(Status.OK, (), CovarianceKind.FORMAL, {"a": 2.0})
    assert h.id == product_id("mana", DERIVED_DFPC, "window", 4000, 0, h.config_hash)
    of_two = derived(*sources, record(3, "minnie"))
    assert of_two.id == product_id("ground", DERIVED_DFPC, "window", of_two.t1_ns, 0, of_two.config_hash)


def test_the_id_of_a_derived_product_depends_on_its_contents() -> None:
    source = record(1)
    assert derived(source).id == derived(source).id
    assert derived(source).id != derived(source, contents=["a", 2]).id


@pytest.mark.parametrize(
    ("status", "purged", "reasons"),
    [
        (Status.OK, 0, ()),
        (Status.DEGRADED, 0, ("degraded_inputs",)),
        (Status.OK, 2, ("purged_inputs",)),
        (Status.DEGRADED, 1, ("degraded_inputs", "purged_inputs")),
    ],
)
def test_degraded_and_purged_sources_degrade_a_derived_product(
    status: Status, purged: int, reasons: tuple[str, ...]
) -> None:
    quality = derived(record(1), record(2, quality=Quality(status)), purged=purged).quality
    assert quality.reasons == reasons
    assert quality.status is (Status.DEGRADED if reasons else Status.OK)


def test_the_end_waits_for_a_running_read_and_cancels_queued_ones() -> None:
    unused: Any = None
    readers, is_cancelled = ThreadPoolExecutor(1), threading.Event()
    patches = Patches(unused, unused, unused, readers=readers)
    running = readers.submit(is_cancelled.wait, 5.0)
    queued = readers.submit(int)
    queued.add_done_callback(lambda _: is_cancelled.set())
    patches.close()
    assert queued.cancelled()
    assert running.result(0.0), "the queued read was cancelled while the other one was running"
