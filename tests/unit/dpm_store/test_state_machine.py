# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""After any sequence of operations the store and a model of it in Python have equal states."""

import copy
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from cdff_common.clock import ManualClock
from cdff_common.errors import ConflictError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from dpm_store import Insertion, NewProduct, Query, Rule, StaleRevisionError, Store, open_store
from dpm_store.payloads.payloads import PACKED_BYTES
from dpm_store.products.transaction import Delete
from tests.support.store_products import NAMES, header, put

S = 1_000_000_000
TYPES, FRAMES, TAGS = ("dem", "pointcloud"), ("site", "mana/odom"), ("a", "b")
X_COORDINATES = st.integers(0, 9)


@dataclass
class ModelProduct:
    """The state of a product in the model."""

    x: float
    product: str
    frame: str
    payload: bytes
    inputs: tuple[int, ...]
    tags: tuple[str, ...] = ()
    pinned: bool = False
    superseded_by: int | None = None
    revision: int = 0
    deleted: bool = False


@dataclass
class World:
    """The model: products by number, and the offsets of the frames."""

    products: dict[int, ModelProduct] = field(default_factory=dict)
    shift: dict[str, float] = field(default_factory=lambda: {"site": 0.0})
    revisions: int = 0

    def live(self) -> list[int]:
        """Numbers of live products."""
        return [seq for seq, stored in self.products.items() if not stored.deleted]

    def find_products(self, low: float, high: float, product: str | None, tag: str | None) -> list[int]:
        """Numbers, newest first, of products whose unit box touches an interval of x in the site."""
        return [
            seq
            for seq in sorted(self.live(), reverse=True)
            if (stored := self.products[seq]).frame in self.shift
            and low <= stored.x + self.shift[stored.frame] + 1.0
            and stored.x + self.shift[stored.frame] <= high
            and product in (None, stored.product)
            and (tag is None or tag in stored.tags)
        ]

    def ancestors(self, products: set[int]) -> set[int]:
        """Inputs of products, through all generations."""
        ancestors: set[int] = set()
        generation = set(products)
        while generation:
            generation = {i for seq in generation for i in self.products[seq].inputs} - ancestors
            ancestors |= generation
        return ancestors


class StoreMachine(RuleBasedStateMachine):
    """Operations on the store and the model."""

    @initialize()
    def begin(self) -> None:
        self.directory = Path(tempfile.mkdtemp())
        shutil.copytree(EMPTY[0], self.directory / "data")
        self.clock = ManualClock(1000 * S)
        self.world, self.earlier_states, self.next = World(), [], 0
        self.store = self.open_store()

    def open_store(self) -> Store:
        return open_store(f"sqlite:///{self.directory}/data", self.clock)

    def save_state(self) -> None:
        """Save the present state for later searches as of this time."""
        self.earlier_states.append((self.clock.now_ns(), copy.deepcopy(self.world)))
        self.clock.set_ns(self.clock.now_ns() + S)

    def id_of(self, seq: int) -> str:
        return header(seq).id

    def new_product(self, seq: int) -> NewProduct:
        stored = self.world.products[seq]
        box = (stored.x, 0.0, 0.0, stored.x + 1.0, 1.0, 1.0)
        result = header(
            seq, box_m=box, frame=stored.frame, inputs=tuple(self.id_of(i) for i in stored.inputs)
        )
        return NewProduct(result, stored.payload, **(NAMES | {"product": stored.product}))

    def new(self, x: int, product: str, frame: str, large: bool, data: st.DataObject) -> int:
        seq, self.next = self.next, self.next + 1
        inputs = (
            data.draw(st.lists(st.sampled_from(sorted(self.world.products)), max_size=2, unique=True))
            if seq
            else []
        )
        payload = bytes([seq % 3]) * (PACKED_BYTES + 1 if large else 10)  # some payloads are equal
        self.world.products[seq] = ModelProduct(float(x), product, frame, payload, tuple(inputs))
        return seq

    def draw_live_product(self, data: st.DataObject) -> int:
        return data.draw(st.sampled_from(self.world.live()))

    @rule(
        x=X_COORDINATES,
        product=st.sampled_from(TYPES),
        frame=st.sampled_from(FRAMES),
        large=st.booleans(),
        data=st.data(),
    )
    def insert(self, x: int, product: str, frame: str, large: bool, data: st.DataObject) -> None:
        self.save_state()
        seq = self.new(x, product, frame, large, data)
        assert self.store.put_all([self.new_product(seq)]) == (Insertion.INSERTED,)

    @rule(xs=st.lists(X_COORDINATES, min_size=1, max_size=4), product=st.sampled_from(TYPES), data=st.data())
    def batch(self, xs: list[int], product: str, data: st.DataObject) -> None:
        self.save_state()
        existing = self.world.live()[:1]
        seqs = existing + [self.new(x, product, "site", False, data) for x in xs]
        results = self.store.put_all([self.new_product(seq) for seq in seqs])
        assert results == (Insertion.ALREADY,) * len(existing) + (Insertion.INSERTED,) * len(xs)

    @precondition(lambda self: self.world.products)
    @rule(data=st.data())
    def insert_other_content(self, data: st.DataObject) -> None:
        seq = data.draw(st.sampled_from(sorted(self.world.products)))
        there = self.new_product(seq)
        with pytest.raises(ConflictError):
            put(self.store, there.header, b"other", product=there.product)

    @precondition(lambda self: self.world.live())
    @rule(tags=st.sets(st.sampled_from(TAGS)), pinned=st.booleans(), stale=st.booleans(), data=st.data())
    def update(self, tags: set[str], pinned: bool, stale: bool, data: st.DataObject) -> None:
        self.save_state()
        seq = self.draw_live_product(data)
        stored = self.world.products[seq]
        changes = {"tags": sorted(tags), "pinned": pinned}
        if stale:
            with pytest.raises(StaleRevisionError):
                self.store.annotations.update(self.id_of(seq), changes, if_match=stored.revision + 1)
            return
        if (stored.tags, stored.pinned) != (tuple(sorted(tags)), pinned):
            stored.tags, stored.pinned, stored.revision = tuple(sorted(tags)), pinned, stored.revision + 1
        there = self.store.annotations.update(self.id_of(seq), changes, if_match=None)
        assert (there.revision, there.tags, there.pinned) == (stored.revision, stored.tags, stored.pinned)

    @precondition(lambda self: len(self.world.live()) > 1)
    @rule(data=st.data())
    def supersede(self, data: st.DataObject) -> None:
        self.save_state()
        seq, by = self.draw_live_product(data), self.draw_live_product(data)
        step: int | None = by
        while step is not None and step != seq:
            step = None if self.world.products[step].deleted else self.world.products[step].superseded_by
        changes = {"superseded_by": self.id_of(by)}
        if step == seq:
            with pytest.raises(ConflictError):
                self.store.annotations.update(self.id_of(seq), changes, if_match=None)
            return
        stored = self.world.products[seq]
        if stored.superseded_by != by:
            stored.superseded_by, stored.revision = by, stored.revision + 1
        assert (
            self.store.annotations.update(self.id_of(seq), changes, if_match=None).revision == stored.revision
        )

    @precondition(lambda self: self.world.products)
    @rule(data=st.data(), purge=st.booleans())
    def delete(self, data: st.DataObject, purge: bool) -> None:
        self.save_state()
        seq = data.draw(st.sampled_from(sorted(self.world.products)))
        stored = self.world.products[seq]
        if stored.pinned and not stored.deleted:
            with pytest.raises(ConflictError):
                self.store.delete(self.id_of(seq))
            return
        assert self.store.delete(self.id_of(seq)) is not stored.deleted
        stored.deleted = True
        if purge:
            self.store.purge(self.id_of(seq))

    @precondition(lambda self: self.world.live())
    @rule(x=X_COORDINATES, fails=st.booleans(), data=st.data())
    def transact(self, x: int, fails: bool, data: st.DataObject) -> None:
        self.save_state()
        deleted = self.draw_live_product(data)
        before, number = copy.deepcopy(self.world), self.next
        seq = self.new(x, "dem", "site", True, data)
        changes = [self.new_product(seq), Delete(self.id_of(deleted), 99 if fails else None)]
        if fails or self.world.products[deleted].pinned:
            with pytest.raises(ConflictError):
                self.store.transact(changes)
            self.world, self.next = before, number
            return
        self.store.transact(changes)
        self.world.products[deleted].deleted = True

    @rule(x=st.integers(-5, 5))
    def reanchor(self, x: int) -> None:
        self.save_state()
        T = UncertainTransform(se3.transform(np.eye(3), (float(x), 0.0, 0.0)))
        self.store.frames.set("mana/odom", "site", T, expected_revision=self.world.revisions)
        self.world.shift["mana/odom"], self.world.revisions = float(x), self.world.revisions + 1

    @rule(count=st.integers(1, 4), product=st.sampled_from(TYPES))
    def retain(self, count: int, product: str) -> None:
        self.save_state()
        of_type = sorted(
            (s for s in self.world.live() if self.world.products[s].product == product), reverse=True
        )
        excess = set(of_type[count:])
        results = {s for s in self.world.live() if s not in excess or self.world.products[s].pinned}
        deleted = excess - results - self.world.ancestors(results)
        rules = [Rule(product=product, max_count=count)]
        retired = {v.id for v in self.store.retention.plan(rules).retired}
        assert retired == {self.id_of(seq) for seq in deleted}
        assert self.store.retention.apply(rules).to_delete == len(deleted)
        for seq in deleted:
            self.world.products[seq].deleted = True

    @rule()
    def collect(self) -> None:
        self.store.collect()

    @rule()
    def reopen(self) -> None:
        self.store.close()
        self.store = self.open_store()

    @rule(
        low=X_COORDINATES,
        width=st.integers(0, 5),
        product=st.sampled_from((None, *TYPES)),
        tag=st.sampled_from((None, *TAGS)),
        limit=st.integers(1, 5),
        data=st.data(),
    )
    def search(
        self, low: int, width: int, product: str | None, tag: str | None, limit: int, data: st.DataObject
    ) -> None:
        as_of_ns, world = data.draw(st.sampled_from([(None, self.world), *self.earlier_states[-5:]]))
        region = parse_region(f"bbox:{low + 0.25},0,{low + width + 0.75},1")
        query = {
            "types": () if product is None else (product,),
            "tags": () if tag is None else (tag,),
            "region": region,
            "as_of_ns": as_of_ns,
            "limit": limit,
        }
        result, cursor = [], None
        while True:
            page = self.store.search(Query(**query, cursor=cursor))
            result += [record.header.seq for record in page.items]
            if (cursor := page.cursor) is None:
                break
        assert result == world.find_products(low + 0.25, low + width + 0.75, product, tag)

    @invariant()
    def payloads_and_statistics_agree_with_the_model(self) -> None:
        if not hasattr(self, "store"):
            return
        for seq, stored in self.world.products.items():
            if stored.deleted:
                with pytest.raises(ProductNotFoundError):
                    self.store.payload(self.id_of(seq))
            else:
                assert self.store.payload(self.id_of(seq)) == stored.payload
        live = [self.world.products[seq] for seq in self.world.live()]
        there = self.store.statistics()
        assert (there.count, there.payload_bytes) == (len(live), sum(len(stored.payload) for stored in live))

    def teardown(self) -> None:
        if hasattr(self, "store"):
            assert self.store.verify() == ()
            self.store.collect()
            live = {self.world.products[seq].payload for seq in self.world.live()}
            there = self.store.statistics()
            assert (there.payloads, there.stored_bytes) == (len(live), sum(map(len, live)))
            assert self.store.verify() == ()
            self.store.close()
            shutil.rmtree(self.directory)


#: Directory of an empty store. A global, because state machines cannot use fixtures.
EMPTY: list[Path] = []


@pytest.mark.parametrize("examples", [8, pytest.param(60, marks=pytest.mark.slow)])
def test_the_store_agrees_with_its_model(empty: Path, examples: int) -> None:
    EMPTY[:] = [empty]
    run_state_machine_as_test(
        StoreMachine,
        settings=settings(
            max_examples=examples,
            stateful_step_count=30,
            deadline=None,
            suppress_health_check=list(HealthCheck),
            derandomize=examples < 10,
        ),
    )
