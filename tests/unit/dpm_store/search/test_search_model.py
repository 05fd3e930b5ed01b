# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Random combinations of search conditions, compared with a check of every product."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from cdff_common.clock import ManualClock
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import Region, parse_region
from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status, product_id
from dpm_store import NewProduct, Query, Store, open_store
from dpm_store.products.records import MetricBound, Order

S = 1_000_000_000
#: Without shrinking, because the creation of the store is slow and queries are short.
PHASES = (Phase.explicit, Phase.reuse, Phase.generate)
SEED, COUNT = 20261121, 500
FRAMES = ("site", "mana/odom", "site_b", "tilted", "nowhere")
TYPES, ROBOTS, DFPCS, TAGS = (
    ("dem", "pointcloud", "image"),
    ("mana", "minnie"),
    ("mapper", "viewer"),
    ("crater", "rock"),
)


@dataclass
class StoredProduct:
    """The expected state of a product."""

    header: Header
    robot: str
    dfpc: str
    product: str
    ordinal: int
    inserted_ns: int
    tags: tuple[str, ...] = ()
    tagged_ns: int = 0
    superseded_ns: int | None = None
    deleted_ns: int | None = None


class World:
    """A store with products and its expected state; edges are ``(time, frame, parent, T)``."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.products: list[StoredProduct] = []
        self.edges: list[tuple[int, str, str, np.ndarray]] = []


def _yaw(x: float, y: float, deg: float, tilt_deg: float = 0.0, z: float = 0.0) -> np.ndarray:
    R = se3.exp_so3([0, 0, np.deg2rad(deg)]) @ se3.exp_so3([np.deg2rad(tilt_deg), 0, 0])
    return se3.transform(R, [x, y, z])


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory, new_stores: Any, engine: str) -> Iterator[World]:
    rng = np.random.default_rng(SEED)
    directory = tmp_path_factory.mktemp("model") / "data"
    clock = ManualClock(1000 * S)
    with open_store(new_stores.of(engine, directory), clock) as store:
        world = World(store)

        def edge(frame: str, parent: str, T: np.ndarray) -> None:
            store.frames.set(frame, parent, UncertainTransform(T))
            world.edges.append((clock.now_ns(), frame, parent, T))

        edge("mana/odom", "site", _yaw(3.0, -2.0, 0.0))
        edge("site", "plain", _yaw(100.0, 0.0, 10.0))
        edge("site_b", "plain", _yaw(130.0, 20.0, 40.0))
        edge("tilted", "site", _yaw(-5.0, 5.0, 20.0, 30.0, 2.0))
        for batch in range(5):
            clock.set_ns((1100 + 100 * batch) * S)
            new_products = [_random_product(rng, batch * 100 + i) for i in range(COUNT // 5)]
            store.put_all(new_products)
            for new_product in new_products:
                record = store.get(new_product.header.id)
                world.products.append(
                    StoredProduct(
                        record.header,
                        record.robot,
                        record.dfpc,
                        record.product,
                        record.ordinal,
                        clock.now_ns(),
                    )
                )
            clock.set_ns((1150 + 100 * batch) * S)
            _change(rng, world, clock)
            if batch == 2:
                edge("site_b", "plain", _yaw(128.0, 25.0, 42.0))
            if batch == 3:
                edge("mana/odom", "site", _yaw(4.0, -2.5, 90.0))
        clock.set_ns(2000 * S)
        yield world


def _random_product(rng: np.random.Generator, seq: int) -> NewProduct:
    t1_ns = int(rng.integers(0, 1000)) * S
    low, size = rng.uniform([-30, -30, -2], [30, 30, 2]), rng.uniform(0.1, 8.0, 3)
    box = (*low.round(3), *(low + size).round(3)) if rng.random() < 0.95 else None
    ring = None
    if box is not None and rng.random() < 0.4:  # a triangle in the box
        x0, y0, _, x1, y1, _ = box
        ring = (x0, y0, x1, y0, x0 if seq % 2 else x1, y1)
    metrics = {"inliers": float(rng.integers(0, 100))} if rng.random() < 0.7 else {}
    quality = Quality(rng.choice([Status.OK, Status.DEGRADED]), (), rng.choice(list(CovarianceKind)), metrics)
    header = Header(
        id=product_id("mana", "test", "map", t1_ns, seq, "c"),
        seq=seq,
        t0_ns=t1_ns - int(rng.integers(0, 50)) * S,
        t1_ns=t1_ns,
        frame=str(rng.choice(FRAMES, p=[0.3, 0.3, 0.2, 0.1, 0.1])),
        producer="test",
        config_hash="c",
        quality=quality,
        box_m=box,
        footprint_m=ring,
        resolution_m=float(rng.choice([0.05, 0.1])) if rng.random() < 0.8 else None,
    )
    robot, dfpc, product = str(rng.choice(ROBOTS)), str(rng.choice(DFPCS)), str(rng.choice(TYPES))
    return NewProduct(header, b"payload", robot, dfpc, "map", product, "ElevationMap")


def _change(rng: np.random.Generator, world: World, clock: ManualClock) -> None:
    live = [p for p in world.products if p.deleted_ns is None]
    for stored in rng.choice(np.array(live, dtype=object), 30, replace=False):
        kind = rng.integers(3)
        if kind == 0:
            world.store.delete(stored.header.id)
            stored.deleted_ns = clock.now_ns()
        elif kind == 1 and not stored.tags:
            stored.tags = tuple(t for t in TAGS if rng.random() < 0.6)
            stored.tagged_ns = clock.now_ns()
            world.store.annotations.update(stored.header.id, {"tags": list(stored.tags)}, if_match=None)
        elif kind == 2 and stored.superseded_ns is None:
            other = next(p for p in reversed(live) if p.deleted_ns is None and p is not stored)
            if other.superseded_ns is None:
                world.store.annotations.update(
                    stored.header.id, {"superseded_by": other.header.id}, if_match=None
                )
                stored.superseded_ns = clock.now_ns()


# -- a check of every product, with geometry by shapely only -------------------------------------------------


def _query_transform(world: World, frame: str, query: Query) -> np.ndarray | None:
    """``T_query_frame`` by composing both chains of parents."""
    edges: dict[str, tuple[str, np.ndarray]] = {}
    for number, (when_ns, child, parent, T) in enumerate(world.edges, 1):
        stored = query.as_of_ns is None or when_ns <= query.as_of_ns
        if stored and (query.frames_revision is None or number <= query.frames_revision):
            edges[child] = (parent, T)

    def to_root(name: str) -> tuple[str, np.ndarray]:
        T = np.eye(4)
        while name in edges:
            name, T_parent_child = edges[name]
            T = T_parent_child @ T
        return name, T

    (root_a, T_root_a), (root_b, T_root_b) = to_root(query.frame), to_root(frame)
    return np.linalg.inv(T_root_a) @ T_root_b if root_a == root_b else None


def _outline(stored: StoredProduct, T: np.ndarray) -> Any:
    x0, y0, z0, x1, y1, z1 = stored.header.box_m  # type: ignore[misc]  # called for products with a box only
    ring = stored.header.footprint_m
    flat = (
        [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        if ring is None
        else list(zip(ring[::2], ring[1::2], strict=True))
    )
    points = np.array([[x, y, z] for z in (z0, z1) for x, y in flat]) @ T[:3, :3].T + T[:3, 3]
    return shapely.convex_hull(shapely.MultiPoint(points[:, :2])), points[:, 2]


def _shape(region: Region) -> Any:
    numbers = region.values
    if region.kind == "circle":
        return shapely.Point(numbers[:2]), numbers[2]
    if region.kind == "path":
        return shapely.LineString(np.array(numbers[1:]).reshape(-1, 2)), numbers[0]
    return shapely.Polygon(region.corners), 0.0


def _is_expected(world: World, stored: StoredProduct, query: Query) -> bool:
    header, now = stored.header, query.as_of_ns
    if now is None:
        exists = stored.deleted_ns is None
    else:
        exists = stored.inserted_ns <= now and (stored.deleted_ns is None or stored.deleted_ns > now)
    # annotations of a deleted product are searched only in earlier states
    tags = stored.tags if now is None or stored.tagged_ns <= now else ()
    superseded = stored.superseded_ns is not None and (now is None or stored.superseded_ns <= now)
    inliers = header.quality.metrics.get("inliers")
    return (
        exists
        and (not query.types or stored.product in query.types)
        and query.robot in (None, stored.robot)
        and query.dfpc in (None, stored.dfpc)
        and query.status in (None, header.quality.status)
        and query.covariance_kind in (None, header.quality.covariance_kind)
        and (query.t0_ns is None or header.t1_ns >= query.t0_ns)
        and (query.t1_ns is None or header.t0_ns <= query.t1_ns)
        and (query.resolution_max_m is None or (header.resolution_m or 9.0) <= query.resolution_max_m)
        and set(query.tags) <= set(tags)
        and (query.superseded is None or superseded == query.superseded)
        and all(inliers is not None and b.low <= inliers <= b.high for b in query.metrics)
        and (query.region is None or _is_inside(world, stored, query))
    )


def _is_inside(world: World, stored: StoredProduct, query: Query) -> bool:
    T = _query_transform(world, stored.header.frame, query)
    if T is None or stored.header.box_m is None:
        return False
    assert query.region is not None
    outline, _ = _outline(stored, T)
    shape, reach = _shape(query.region)
    if query.region.kind == "box":
        _, heights = _outline(StoredProduct(replace(stored.header, footprint_m=None), "", "", "", 0, 0), T)
        if heights.min() > query.region.values[5] or heights.max() < query.region.values[2]:
            return False
        v = query.region.values
        corners = (
            np.array([[x, y, z, 1] for x in v[0::3] for y in v[1::3] for z in v[2::3]]) @ np.linalg.inv(T).T
        )
        box = np.array(stored.header.box_m)
        if (corners[:, :3].max(axis=0) < box[:3]).any() or (corners[:, :3].min(axis=0) > box[3:]).any():
            return False
    return bool(outline.distance(shape) <= reach)


def _expected(world: World, query: Query) -> list[StoredProduct]:
    result = [p for p in world.products if _is_expected(world, p, query)]
    if query.order is Order.NEAREST:
        assert query.region is not None or query.point is not None
        point = shapely.Point(query.point or query.region.centre)  # type: ignore[union-attr]
        with_distance = []
        for p in result:
            T = _query_transform(world, p.header.frame, query)
            if T is not None and p.header.box_m is not None:
                with_distance.append((_outline(p, T)[0].distance(point), -p.header.t1_ns, -p.ordinal, p))
        return [p for *_, p in sorted(with_distance, key=lambda place: place[:3])]
    sign = 1 if query.order is Order.OLDEST else -1
    return sorted(result, key=lambda p: (sign * p.header.t1_ns, sign * p.ordinal))


numbers = st.floats(-40, 40).map(lambda v: round(v, 2) + 0.0013)
sizes = st.floats(0.5, 40).map(lambda v: round(v, 2) + 0.0007)


def _text(kind: str, values: list[float]) -> str:
    return f"{kind}:" + ",".join(f"{v:.6f}" for v in values)


regions = st.one_of(
    st.tuples(numbers, numbers, sizes, sizes).map(
        lambda v: _text("bbox", [v[0], v[1], v[0] + v[2], v[1] + v[3]])
    ),
    st.tuples(numbers, numbers, st.floats(-3, 3), sizes, sizes, st.floats(0.1, 4)).map(
        lambda v: _text("box", [*v[:3], v[0] + v[3], v[1] + v[4], v[2] + v[5]])
    ),
    st.tuples(numbers, numbers, sizes).map(lambda v: _text("circle", list(v))),
    st.tuples(numbers, numbers, sizes, sizes).map(
        lambda v: _text(
            "polygon", [v[0], v[1], v[0] + v[2], v[1], v[0] + v[2] / 3, v[1] + v[3] / 3, v[0], v[1] + v[3]]
        )
    ),
    st.tuples(sizes, st.lists(numbers, min_size=4, max_size=12).filter(lambda n: len(n) % 2 == 0)).map(
        lambda v: _text("path", [v[0] / 10, *v[1]])
    ),
).map(parse_region)
optional = st.none


@st.composite
def queries(draw: st.DrawFn) -> Query:
    region = draw(optional() | regions)
    order, point = draw(st.sampled_from(list(Order))), None
    if order is Order.NEAREST:
        point = (
            draw(st.tuples(numbers, numbers))
            if region is None
            else draw(optional() | st.tuples(numbers, numbers))
        )
    span = sorted(draw(st.lists(st.integers(0, 1000), min_size=2, max_size=2)))
    interval = draw(
        st.sampled_from([(None, None), (span[0] * S, None), (None, span[1] * S), (span[0] * S, span[1] * S)])
    )
    state = draw(optional() | st.integers(3, 6))
    return Query(
        types=tuple(draw(st.sets(st.sampled_from(TYPES), max_size=2))),
        robot=draw(optional() | st.sampled_from(ROBOTS)),
        dfpc=draw(optional() | optional() | st.sampled_from(DFPCS)),
        status=draw(optional() | optional() | st.sampled_from(["OK", "DEGRADED"])),
        covariance_kind=draw(optional() | optional() | st.sampled_from([str(k) for k in CovarianceKind])),
        t0_ns=interval[0],
        t1_ns=interval[1],
        region=region,
        frame=draw(st.sampled_from(["site", "site", "mana/odom", "site_b", "tilted"])),
        resolution_max_m=draw(optional() | optional() | st.sampled_from([0.05, 0.1])),
        tags=tuple(draw(optional() | optional() | st.sampled_from([("crater",), TAGS])) or ()),
        as_of_ns=draw(optional() | st.integers(1090, 1700).map(lambda s: s * S)),
        superseded=draw(optional() | optional() | st.booleans()),
        frames_revision=state,
        metrics=draw(
            st.sampled_from([(), (), (MetricBound("inliers", 30.0),), (MetricBound("inliers", 20.0, 60.0),)])
        ),
        order=order,
        point=point,
        limit=draw(st.sampled_from([1, 7, 40, 1000])),
    )


@pytest.mark.req("CDFF-SUP-082")
@settings(max_examples=60, deadline=None, phases=PHASES)
@given(query=queries())
@pytest.mark.slow
def test_every_combination_equals_a_check_of_each_product(world: World, query: Query) -> None:
    results: list[str] = []
    distances: list[float] = []
    cursor = None
    for _ in range(12):
        page = world.store.search(replace(query, cursor=cursor))
        results += [record.id for record in page.items]
        distances += page.distances_m
        cursor = page.cursor
        if cursor is None:
            break
    expected = [stored.header.id for stored in _expected(world, query)]
    if (
        query.order is Order.NEAREST
    ):  # distances of two libraries differ by rounding: products of equal distance may be exchanged
        assert distances == sorted(distances)
        if cursor is None:
            assert sorted(results) == sorted(expected)
        by_id = {stored.header.id: stored for stored in world.products}
        point = shapely.Point(query.point or query.region.centre)  # type: ignore[union-attr]
        T = {f: _query_transform(world, f, query) for f in FRAMES}
        outlines = [_outline(by_id[i], T[by_id[i].header.frame])[0] for i in results]  # type: ignore[arg-type]
        exact = [outline.distance(point) for outline in outlines]
        assert distances == pytest.approx(exact, abs=1e-9)
        nearest = [
            _outline(by_id[i], T[by_id[i].header.frame])[0].distance(point) for i in expected[: len(results)]
        ]  # type: ignore[arg-type]
        assert distances == pytest.approx(nearest, abs=1e-9)
    else:
        assert results == expected[: len(results)]
        assert cursor is not None or len(results) == len(expected)
