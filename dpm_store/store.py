# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The store as a whole: opened once, used from any thread, closed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.clock import Clock, WallClock
from cdff_common.interfaces.product import Header
from cdff_common.output import make_folder
from dpm_store import pose_graphs
from dpm_store.annotations import AnnotationTable
from dpm_store.clouds import Clouds
from dpm_store.database import Database, directory_of
from dpm_store.events import EventTable
from dpm_store.extents import Extent, extents, frame_names
from dpm_store.footprints import footprints
from dpm_store.frames import FrameTable
from dpm_store.lock import DirectoryLock
from dpm_store.maintenance import Problem, Statistics, collect, statistics, verify
from dpm_store.maps import Maps
from dpm_store.migrate import migrate
from dpm_store.patches import Patches
from dpm_store.payloads import Payloads
from dpm_store.places import Places
from dpm_store.pose_graphs import NodeFound
from dpm_store.poses import PoseTable, Track
from dpm_store.products import ProductTable
from dpm_store.provenance import MAX_GENERATIONS, Lineage, lineage
from dpm_store.purge import purge
from dpm_store.pyramid import Pyramid
from dpm_store.records import Insertion, Page, Parcel, ProductRecord, Query
from dpm_store.retention import Retention
from dpm_store.robots import RobotTable
from dpm_store.room import LOW_WATER_BYTES, Room
from dpm_store.search import Search
from dpm_store.tracks import path
from dpm_store.transaction import Change, Outcome, Transactions

if TYPE_CHECKING:
    from cdff_common.types import PoseGraph

_DATABASE = "store.sqlite"
_TILES = "tiles"


def open_store(
    url: str, clock: Clock | None = None, *, low_water_bytes: int = LOW_WATER_BYTES, reserve_bytes: int = 0
) -> Store:
    """Open or make a store.

    Parameters
    ----------
    url : str
        ``sqlite:///directory``; made if it is not there.
    clock : Clock, optional
        Mission clock for insertion times; the wall clock by default.
    low_water_bytes : int
        Additions must leave so much on the disk, else they are refused; see ``Room``.
    reserve_bytes : int
        Kept in a file so that deletion works on a disk that others have filled.

    Raises
    ------
    ConfigurationError
        On another kind of URL, or a store made by a newer version.
    UnavailableError
        If another process has it open.
    StorageError
        If the disk is full or fails.
    """
    return Store(directory_of(url), clock or WallClock(), low_water_bytes, reserve_bytes)


class Store:
    """Products, frames, poses and events of a mission; a context manager.

    Attributes
    ----------
    frames : FrameTable
        Revisioned fixed edges.
    places : Places
        Bodies, and where frames are on them.
    robots : RobotTable
        What robots are.
    poses : PoseTable
        Moving edges, and lookups over both.
    events : EventTable
        Append-only history.
    annotations : AnnotationTable
        Tags, notes, pins, judgements and successors of products, by revision.
    retention : Retention
        Rules of what may go.
    maps : Maps
        Windows pooled from patches.
    clouds : Clouds
        Points of a region from all clouds, within a budget.
    pyramid : Pyramid
        Statistics of tiles, at every level.
    """

    def __init__(
        self, directory: Path, clock: Clock, low_water_bytes: int = LOW_WATER_BYTES, reserve_bytes: int = 0
    ) -> None:
        make_folder(directory)
        self.directory = directory
        self.clock = clock
        self._lock = DirectoryLock(directory)
        try:
            self._database = Database(directory / _DATABASE, Room(directory, low_water_bytes, reserve_bytes))
            migrate(self._database)
            self._payloads = Payloads(directory)
        except BaseException:
            self._lock.release()
            raise
        self.events = EventTable(self._database, clock)
        self.frames = FrameTable(self._database, self.events, clock)
        self.places = Places(self._database, self.frames, self.events, clock)
        self.robots = RobotTable(self._database, self.events, clock)
        self.poses = PoseTable(self._database, self.frames)
        self.annotations = AnnotationTable(self._database, self.events, clock)
        self._products = ProductTable(self._database, self._payloads, self.events, self.annotations, clock)
        self._transactions = Transactions(self._database, self._products, self.annotations, self.frames)
        self.retention = Retention(self._database, self._products, clock)
        self._search = Search(self._database, self._products, self.frames, self.poses)
        patches = Patches(self._search, self._products, self.frames)
        self.maps = Maps(patches)
        self.clouds = Clouds(self._search, self._products, self.frames)
        self.pyramid = Pyramid(self._database, patches, self.frames, self.events, directory / _TILES)

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def put(
        self, header: Header, payload: bytes, *, robot: str, dfpc: str, port: str, product: str, type_name: str,
        codec: str = "uper", value: Any = None,
    ) -> Insertion:  # fmt: skip
        """Insert a product; durable when this returns. See ``ProductTable.put``."""
        return self._products.put(
            header, payload, robot=robot, dfpc=dfpc, port=port, product=product, type_name=type_name, codec=codec,
            value=value,
        )  # fmt: skip

    def put_all(self, parcels: Sequence[Parcel]) -> tuple[Insertion, ...]:
        """Insert several products in one transaction, all or none. See ``ProductTable.put_all``."""
        return self._products.put_all(parcels)

    def get(self, product_id: str, *, deleted: bool = False) -> ProductRecord:
        """Metadata by id. See ``ProductTable.get``."""
        return self._products.get(product_id, deleted=deleted)

    def payload(self, product_id: str, offset: int = 0, length: int | None = None) -> bytes:
        """Bytes of a payload, checked against what was written. See ``ProductTable.payload``."""
        return self._products.payload(product_id, offset, length)

    def search(self, query: Query | None = None) -> Page:
        """One page of products. See ``Query`` and ``Search.run``."""
        return self._search.run(query or Query())

    def delete(self, product_id: str) -> bool:
        """Leave a tombstone. See ``ProductTable.delete``."""
        return self._products.delete(product_id)

    def purge(self, product_id: str) -> int:
        """Remove the payload of a deleted product. See ``purge.purge``."""
        return purge(self._database, self._payloads, self.events, product_id)

    def transact(self, changes: Sequence[Change]) -> tuple[Outcome, ...]:
        """Make several changes in one transaction, all or none. See ``Transactions.run``."""
        return self._transactions.run(changes)

    def lineage(self, product_id: str, direction: str = "up", depth: int = MAX_GENERATIONS) -> Lineage:
        """What a product was made from, or what was made from it. See ``provenance.lineage``."""
        return lineage(self._database, product_id, direction, depth)

    def verify(self) -> tuple[Problem, ...]:
        """Look at everything that is stored; what was found wrong, empty when sound."""
        return verify(self._database, self._payloads)

    def collect(self) -> int:
        """Remove payloads that no live product names; returns the bytes freed."""
        return collect(self._database, self._payloads)

    def statistics(self) -> Statistics:
        """Counts and sizes."""
        return statistics(self._database)

    def extents(self) -> tuple[Extent, ...]:
        """What the products of each type and frame span; reads every row."""
        return extents(self._database)

    def footprints(self, ids: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Outlines of products by id. See ``footprints.footprints``."""
        with self._database.read() as connection:
            return footprints(connection, ids)

    def frame_names(self) -> tuple[str, ...]:
        """Frames that products lie or lay in."""
        return frame_names(self._database)

    def path(self, track: Track, most: int) -> NDArray[np.float64]:
        """Positions of a moving frame, thinned. See ``tracks.path``."""
        return path(self._database, track, most)

    def pose_graph(self, product_id: str) -> PoseGraph:
        """A pose graph from its nodes and edges. See ``pose_graphs.read``."""
        return pose_graphs.read(self._database, product_id)

    def pose_graph_nodes(self, product_id: str, t0_ns: int, t1_ns: int) -> tuple[NodeFound, ...]:
        """Nodes of a pose graph in a span of time. See ``pose_graphs.nodes_between``."""
        return pose_graphs.nodes_between(self._database, product_id, t0_ns, t1_ns)

    def close(self) -> None:
        """Close the database and let another process open it."""
        self.pyramid.close()
        self._database.close()
        self._payloads.close()
        self._lock.release()
