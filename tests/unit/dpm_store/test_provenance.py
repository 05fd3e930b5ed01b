# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import pytest

from cdff_common.errors import InputError, ProductNotFoundError
from dpm_store import Store

from .conftest import header, put

A, B, C, D = (header(seq).id for seq in range(4))


@pytest.fixture
def family(store: Store) -> Store:
    """``sample`` -> A, B; A and B -> C; A and C -> D."""
    put(store, header(0, inputs=("sample",)))
    put(store, header(1, inputs=("sample",)))
    put(store, header(2, inputs=(A, B)))
    put(store, header(3, inputs=(A, C)))
    return store


@pytest.mark.req("CDFF-SUP-031")
def test_what_a_product_was_made_from_is_found_through_all_generations(family: Store) -> None:
    found = family.lineage(D)
    assert [set(ids) for ids in found.generations] == [{A, C}, {"sample", B}]
    assert set(found.links) == {(D, A), (D, C), (A, "sample"), (C, A), (C, B), (B, "sample")}
    assert found.records.keys() == {A, B, C}
    assert not found.truncated


def test_what_was_made_from_a_product_is_found_even_where_a_link_was_deleted(family: Store) -> None:
    family.delete(C)
    found = family.lineage(B, "down")
    assert found.generations == ((C,), (D,))
    assert found.records[C].deleted_ns is not None


def test_the_depth_bounds_the_generations_and_says_so(family: Store) -> None:
    found = family.lineage(D, depth=1)
    assert len(found.generations) == 1
    assert found.truncated
    assert not family.lineage(A, "up", depth=1).truncated


def test_products_that_name_each_other_end(store: Store) -> None:
    put(store, header(0, inputs=(B,)))
    put(store, header(1, inputs=(A,)))
    assert store.lineage(A).generations == ((B,),)


def test_unknown_products_and_directions_are_refused(family: Store) -> None:
    with pytest.raises(ProductNotFoundError):
        family.lineage("none")
    for direction, depth in (("sideways", 1), ("up", 0), ("up", 65)):
        with pytest.raises(InputError, match="provenance"):
            family.lineage(A, direction, depth)
