# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import pytest

from cdff_common.errors import InputError, ProductNotFoundError
from dpm_store import Store
from tests.support.store_products import header, put

A, B, C, D = (header(seq).id for seq in range(4))


@pytest.fixture
def family(store: Store) -> Store:
    """A store with products of these inputs: sample → A, B; A, B → C; A, C → D."""
    put(store, header(0, inputs=("sample",)))
    put(store, header(1, inputs=("sample",)))
    put(store, header(2, inputs=(A, B)))
    put(store, header(3, inputs=(A, C)))
    return store


@pytest.mark.req("CDFF-SUP-031")
def test_inputs_are_found_through_all_generations(family: Store) -> None:
    lineage = family.lineage(D)
    assert [set(ids) for ids in lineage.generations] == [{A, C}, {"sample", B}]
    assert set(lineage.links) == {(D, A), (D, C), (A, "sample"), (C, A), (C, B), (B, "sample")}
    assert lineage.records.keys() == {A, B, C}
    assert not lineage.truncated


def test_derived_products_are_found_through_deleted_ones(family: Store) -> None:
    family.delete(C)
    lineage = family.lineage(B, "down")
    assert lineage.generations == ((C,), (D,))
    assert lineage.records[C].deleted_ns is not None


def test_the_depth_limits_the_generations_and_is_reported(family: Store) -> None:
    lineage = family.lineage(D, depth=1)
    assert len(lineage.generations) == 1
    assert lineage.truncated
    assert not family.lineage(A, "up", depth=1).truncated


def test_circular_inputs_terminate(store: Store) -> None:
    put(store, header(0, inputs=(B,)))
    put(store, header(1, inputs=(A,)))
    assert store.lineage(A).generations == ((B,),)


def test_unknown_products_and_directions_are_refused(family: Store) -> None:
    with pytest.raises(ProductNotFoundError):
        family.lineage("none")
    for direction, depth in (("sideways", 1), ("up", 0), ("up", 65)):
        with pytest.raises(InputError, match="provenance"):
            family.lineage(A, direction, depth)
