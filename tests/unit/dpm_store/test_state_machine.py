# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Any sequence of operations leaves the store and a model of it in plain Python in the same state."""

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
from dpm_store import Insertion, Parcel, Query, Rule, StaleRevisionError, Store, open_store
from dpm_store.payloads import PACKED_BYTES
from dpm_store.transaction import Delete, Insert

from .conftest import NAMES, header

S = 1_000_000_000
TYPES, FRAMES, TAGS = ("dem", "pointcloud"), ("site", "mana/odom"), ("a", "b")
PLACES = st.integers(0, 9)


@dataclass
class Known:
    """What the model says of a product."""

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
    """The model: products by number, and where the frames lie."""

    products: dict[int, Known] = field(default_factory=dict)
    shift: dict[str, float] = field(default_factory=lambda: {"site": 0.0})
    revisions: int = 0

    def live(self) -> list[int]:
        """Numbers of products that were not deleted."""
        return [seq for seq, known in self.products.items() if not known.deleted]

    def found(self, low: float, high: float, product: str | None, tag: str | None) -> list[int]:
        """Numbers, newest first, of products whose unit box touches an interval of x in the site."""
        return [
            seq
            for seq in sorted(self.live(), reverse=True)
            if (known := self.products[seq]).frame in self.shift
            and low <= known.x + self.shift[known.frame] + 1.0
            and known.x + self.shift[known.frame] <= high
            and product in (None, known.product)
            and (tag is None or tag in known.tags)
        ]

    def roots(self, kept: set[int]) -> set[int]:
        """What some products were made from, through all generations."""
        seen: set[int] = set()
        front = set(kept)
        while front:
            front = {i for seq in front for i in self.products[seq].inputs} - seen
            seen |= front
        return seen


class StoreMachine(RuleBasedStateMachine):
    """Operations on both."""

    @initialize()
    def begin(self) -> None:
        self.directory = Path(tempfile.mkdtemp())
        shutil.copytree(EMPTY[0], self.directory / "data")
        self.clock = ManualClock(1000 * S)
        self.world, self.past, self.next = World(), [], 0
        self.store = self.opened()

    def opened(self) -> Store:
        return open_store(f"sqlite:///{self.directory}/data", self.clock)

    def tick(self) -> None:
        """What was known up to now is kept for questions of it."""
        self.past.append((self.clock.now_ns(), copy.deepcopy(self.world)))
        self.clock.set_ns(self.clock.now_ns() + S)

    def id_of(self, seq: int) -> str:
        return header(seq).id

    def parcel(self, seq: int) -> Parcel:
        known = self.world.products[seq]
        box = (known.x, 0.0, 0.0, known.x + 1.0, 1.0, 1.0)
        made = header(seq, box_m=box, frame=known.frame, inputs=tuple(self.id_of(i) for i in known.inputs))
        return Parcel(made, known.payload, **(NAMES | {"product": known.product}))

    def new(self, x: int, product: str, frame: str, large: bool, data: st.DataObject) -> int:
        seq, self.next = self.next, self.next + 1
        inputs = (
            data.draw(st.lists(st.sampled_from(sorted(self.world.products)), max_size=2, unique=True)) if seq else []
        )
        payload = bytes([seq % 3]) * (PACKED_BYTES + 1 if large else 10)  # some share their content
        self.world.products[seq] = Known(float(x), product, frame, payload, tuple(inputs))
        return seq

    def pick(self, data: st.DataObject) -> int:
        return data.draw(st.sampled_from(self.world.live()))

    @rule(x=PLACES, product=st.sampled_from(TYPES), frame=st.sampled_from(FRAMES), large=st.booleans(), data=st.data())
    def insert(self, x: int, product: str, frame: str, large: bool, data: st.DataObject) -> None:
        self.tick()
        seq = self.new(x, product, frame, large, data)
        assert self.store.put_all([self.parcel(seq)]) == (Insertion.INSERTED,)

    @rule(xs=st.lists(PLACES, min_size=1, max_size=4), product=st.sampled_from(TYPES), data=st.data())
    def batch(self, xs: list[int], product: str, data: st.DataObject) -> None:
        self.tick()
        again = self.world.live()[:1]
        seqs = again + [self.new(x, product, "site", False, data) for x in xs]
        done = self.store.put_all([self.parcel(seq) for seq in seqs])
        assert done == (Insertion.ALREADY,) * len(again) + (Insertion.INSERTED,) * len(xs)

    @precondition(lambda self: self.world.products)
    @rule(data=st.data())
    def insert_other_content(self, data: st.DataObject) -> None:
        seq = data.draw(st.sampled_from(sorted(self.world.products)))
        there = self.parcel(seq)
        with pytest.raises(ConflictError):
            self.store.put(there.header, b"other", **(NAMES | {"product": there.product}))

    @precondition(lambda self: self.world.live())
    @rule(tags=st.sets(st.sampled_from(TAGS)), pinned=st.booleans(), stale=st.booleans(), data=st.data())
    def update(self, tags: set[str], pinned: bool, stale: bool, data: st.DataObject) -> None:
        self.tick()
        seq = self.pick(data)
        known = self.world.products[seq]
        changes = {"tags": sorted(tags), "pinned": pinned}
        if stale:
            with pytest.raises(StaleRevisionError):
                self.store.annotations.update(self.id_of(seq), changes, if_match=known.revision + 1)
            return
        if (known.tags, known.pinned) != (tuple(sorted(tags)), pinned):
            known.tags, known.pinned, known.revision = tuple(sorted(tags)), pinned, known.revision + 1
        there = self.store.annotations.update(self.id_of(seq), changes, if_match=None)
        assert (there.revision, there.tags, there.pinned) == (known.revision, known.tags, known.pinned)

    @precondition(lambda self: len(self.world.live()) > 1)
    @rule(data=st.data())
    def supersede(self, data: st.DataObject) -> None:
        self.tick()
        seq, by = self.pick(data), self.pick(data)
        step: int | None = by
        while step is not None and step != seq:
            step = None if self.world.products[step].deleted else self.world.products[step].superseded_by
        changes = {"superseded_by": self.id_of(by)}
        if step == seq:
            with pytest.raises(ConflictError):
                self.store.annotations.update(self.id_of(seq), changes, if_match=None)
            return
        known = self.world.products[seq]
        if known.superseded_by != by:
            known.superseded_by, known.revision = by, known.revision + 1
        assert self.store.annotations.update(self.id_of(seq), changes, if_match=None).revision == known.revision

    @precondition(lambda self: self.world.products)
    @rule(data=st.data(), purge=st.booleans())
    def delete(self, data: st.DataObject, purge: bool) -> None:
        self.tick()
        seq = data.draw(st.sampled_from(sorted(self.world.products)))
        known = self.world.products[seq]
        if known.pinned and not known.deleted:
            with pytest.raises(ConflictError):
                self.store.delete(self.id_of(seq))
            return
        assert self.store.delete(self.id_of(seq)) is not known.deleted
        known.deleted = True
        if purge:
            self.store.purge(self.id_of(seq))

    @precondition(lambda self: self.world.live())
    @rule(x=PLACES, fails=st.booleans(), data=st.data())
    def transact(self, x: int, fails: bool, data: st.DataObject) -> None:
        self.tick()
        gone = self.pick(data)
        before, number = copy.deepcopy(self.world), self.next
        seq = self.new(x, "dem", "site", True, data)
        changes = [Insert(self.parcel(seq)), Delete(self.id_of(gone), 99 if fails else None)]
        if fails or self.world.products[gone].pinned:
            with pytest.raises(ConflictError):
                self.store.transact(changes)
            self.world, self.next = before, number
            return
        self.store.transact(changes)
        self.world.products[gone].deleted = True

    @rule(x=st.integers(-5, 5))
    def reanchor(self, x: int) -> None:
        self.tick()
        T = UncertainTransform(se3.transform(np.eye(3), (float(x), 0.0, 0.0)))
        self.store.frames.set("mana/odom", "site", T, expected_revision=self.world.revisions)
        self.world.shift["mana/odom"], self.world.revisions = float(x), self.world.revisions + 1

    @rule(count=st.integers(1, 4), product=st.sampled_from(TYPES))
    def retain(self, count: int, product: str) -> None:
        self.tick()
        of_type = sorted((s for s in self.world.live() if self.world.products[s].product == product), reverse=True)
        going = set(of_type[count:])
        kept = {s for s in self.world.live() if s not in going or self.world.products[s].pinned}
        gone = going - kept - self.world.roots(kept)
        rules = [Rule(product, max_count=count)]
        told = {v.product_id for v in self.store.retention.plan(rules).retired}
        assert told == {self.id_of(seq) for seq in gone}
        assert self.store.retention.apply(rules).going == len(gone)
        for seq in gone:
            self.world.products[seq].deleted = True

    @rule()
    def collect(self) -> None:
        self.store.collect()

    @rule()
    def reopen(self) -> None:
        self.store.close()
        self.store = self.opened()

    @rule(
        low=PLACES, width=st.integers(0, 5), product=st.sampled_from((None, *TYPES)),
        tag=st.sampled_from((None, *TAGS)),
        limit=st.integers(1, 5), data=st.data(),
    )  # fmt: skip
    def search(
        self, low: int, width: int, product: str | None, tag: str | None, limit: int, data: st.DataObject
    ) -> None:
        then_ns, world = data.draw(st.sampled_from([(None, self.world), *self.past[-5:]]))
        region = parse_region(f"bbox:{low + 0.25},0,{low + width + 0.75},1")
        query = {
            "types": () if product is None else (product,), "tags": () if tag is None else (tag,), "region": region,
            "as_of_ns": then_ns, "limit": limit,
        }  # fmt: skip
        found, cursor = [], None
        while True:
            page = self.store.search(Query(**query, cursor=cursor))
            found += [record.header.seq for record in page.items]
            if (cursor := page.cursor) is None:
                break
        assert found == world.found(low + 0.25, low + width + 0.75, product, tag)

    @invariant()
    def payloads_and_sums_are_the_models(self) -> None:
        if not hasattr(self, "store"):
            return
        for seq, known in self.world.products.items():
            if known.deleted:
                with pytest.raises(ProductNotFoundError):
                    self.store.payload(self.id_of(seq))
            else:
                assert self.store.payload(self.id_of(seq)) == known.payload
        live = [self.world.products[seq] for seq in self.world.live()]
        there = self.store.statistics()
        assert (there.count, there.payload_bytes) == (len(live), sum(len(known.payload) for known in live))

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


#: Directory of an empty store, for the machines, which know no fixtures.
EMPTY: list[Path] = []


@pytest.mark.parametrize("examples", [8, pytest.param(60, marks=pytest.mark.slow)])
def test_the_store_does_what_its_model_does(empty: Path, examples: int) -> None:
    EMPTY[:] = [empty]
    run_state_machine_as_test(
        StoreMachine,
        settings=settings(
            max_examples=examples, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck),
            derandomize=examples < 10,
        ),
    )  # fmt: skip
