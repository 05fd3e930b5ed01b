# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The store: opened once per process, usable from any thread."""

from __future__ import annotations

import os
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import TracebackType

from cdff_common.clock import Clock, WallClock
from cdff_common.errors import StorageError
from cdff_common.output import make_folder
from cdff_common.process import lock_file
from dpm_store.changes.change_recorder import ChangeRecorder, ServerChanges
from dpm_store.engine.commit_watch import CommitWatch
from dpm_store.engine.database import Database
from dpm_store.engine.disk_space import LOW_WATER_BYTES, DiskSpace
from dpm_store.engine.location import StoreLocation, parse_url
from dpm_store.engine.migrate import migrate, revision_of
from dpm_store.engine.notes import read_note, write_note
from dpm_store.frames.anchors import AnchorTable
from dpm_store.frames.frames import FrameTable
from dpm_store.frames.poses import PoseTable
from dpm_store.frames.robots import RobotTable
from dpm_store.history.clock_reference import read_clock_reference, write_clock_reference
from dpm_store.history.events import EventTable
from dpm_store.history.maintenance import collect, statistics, verify
from dpm_store.history.provenance import lineage
from dpm_store.history.purge import purge
from dpm_store.history.retention import Retention
from dpm_store.history.unnamed import unnamed_payloads
from dpm_store.maps import tile_files
from dpm_store.maps.clouds import Clouds
from dpm_store.maps.elevation import Maps
from dpm_store.maps.patches import Patches
from dpm_store.maps.pyramid import Pyramid
from dpm_store.payloads.payloads import Payloads, has_payloads
from dpm_store.products import pose_graphs
from dpm_store.products.annotations import AnnotationTable
from dpm_store.products.products import ProductTable
from dpm_store.products.transaction import Transactions
from dpm_store.search.extents import extents, frame_names, origins
from dpm_store.search.footprints import footprints
from dpm_store.search.search import Search


def open_store(
    url: str,
    clock: Clock | None = None,
    *,
    low_water_bytes: int = LOW_WATER_BYTES,
    reserve_bytes: int = 0,
    new: bool = False,
) -> Store:
    """Open a store, or create it.

    Parameters
    ----------
    url : str
        ``sqlite:///directory``, or ``postgresql+psycopg://user@host/database?directory=/path``, with
        ``&payloads=s3://bucket/prefix`` for payloads that several processes share.
    clock : Clock, optional
        Mission clock of insertion times; the wall clock by default.
    low_water_bytes : int
        Space that additions must leave on the disk; see ``DiskSpace``.
    reserve_bytes : int
        Size of a file that allows deletions on a full disk.
    new : bool
        Create a database although there are payloads of an earlier one.

    Raises
    ------
    ConfigurationError
        If the URL is of another form, the driver is missing, or the store has an incompatible version.
    UnavailableError
        If another process has it open.
    StorageError
        If the disk is full or fails, or the database is missing while there are payloads.
    """
    return Store(parse_url(url), clock or WallClock(), low_water_bytes, reserve_bytes, new=new, url=url)


class Store:
    """Products, frames, poses and events of a mission; a context manager.

    Attributes
    ----------
    directory : Path
    url : str
        URL with which the store was opened.
    frames : FrameTable
        Revisioned fixed edges.
    anchors : AnchorTable
        Bodies, and the anchors of frames on them.
    robots : RobotTable
        Descriptions of robots.
    poses : PoseTable
        Moving edges, and lookups over both.
    events : EventTable
        Append-only history.
    annotations : AnnotationTable
        Tags, notes, pins, assessments and successors of products, by revision.
    products : ProductTable
        Insertion, retrieval and deletion; ``put_all``, ``get``, ``payload`` and ``delete`` are its
        methods.
    retention : Retention
        Deletion of products by rules.
    maps : Maps
        Windows pooled from patches.
    clouds : Clouds
        Points of a region from all clouds, within a budget.
    pyramid : Pyramid
        Statistics of tiles, at every level.
    search, count, ordinals_in : callable
        ``Search.run``: a page of products by a ``Query``; the other two: the products on all pages.
    disk_space : DiskSpace
    changes : ChangeRecorder or ServerChanges
        Records of all changes outside the database.
    transact : callable
        ``Transactions.run``: several changes, all or none.
    """

    def __init__(
        self,
        location: StoreLocation,
        clock: Clock,
        low_water_bytes: int,
        reserve_bytes: int,
        *,
        new: bool = False,
        url: str = "",
    ) -> None:
        directory, dialect = location.directory, location.dialect
        make_folder(directory)
        self.directory, self.url = directory, url
        self.clock = clock
        with ExitStack() as exit_stack:
            lock = lock_file(directory / "store.lock", str(os.getpid()), partial(in_use, directory))
            exit_stack.callback(os.close, lock)
            must_exist = not new and has_payloads(directory)
            if must_exist and not (directory / dialect.FILE_NAME).exists():
                raise StorageError(_without_database(directory))
            self.disk_space = disk_space = DiskSpace(directory, low_water_bytes, reserve_bytes)
            self._database = database = Database(directory, disk_space, dialect, location.database)
            exit_stack.callback(database.close)
            if must_exist and revision_of(database) is None:
                raise StorageError(_without_database(directory))
            migrate(database)
            self._payloads = payloads = Payloads(directory, dialect, location.payloads, location.cache_bytes)
            exit_stack.callback(payloads.packs.close)
            self.changes: ChangeRecorder | ServerChanges = (
                ServerChanges() if location.database else ChangeRecorder(directory, database, payloads)
            )
            exit_stack.callback(self.changes.close)
            self._opened = exit_stack.pop_all()  # they stay open unless a step failed
        self.events = EventTable(database, clock)
        self.frames = FrameTable(database, self.events, clock)
        self.anchors = AnchorTable(database, self.frames, self.events, clock)
        self.robots = RobotTable(database, self.events, clock)
        self.poses = PoseTable(database, self.frames)
        self.annotations = AnnotationTable(database, self.events, clock)
        self.products = products = ProductTable(database, payloads, self.events, self.annotations, clock)
        self.retention = Retention(database, products, clock)
        search = Search(database, products, self.frames, self.poses)
        patches = Patches(search, products, self.frames)
        self.maps = Maps(patches)
        self.clouds = Clouds(patches.of("pointcloud", "Pointcloud"), products)
        self.pyramid = Pyramid(database, patches, self.frames, self.events, directory / tile_files.FOLDER)
        # operations of the parts
        self.put_all, self.delete = products.put_all, products.delete
        self.get, self.payload, self.live = products.get, products.payload, products.live
        self.search, self.count, self.ordinals_in = search.run, search.count, search.ordinals_in
        self.transact = Transactions(database, products, self.annotations, self.frames, self.events).run
        self.purge = partial(purge, database, payloads, self.events)
        self.lineage = partial(lineage, database)
        self.verify = partial(verify, database, payloads, self.changes)
        self.collect = partial(collect, database, payloads, self.changes)
        self.damaged_payloads = payloads.damaged
        self.unnamed_payloads = partial(unnamed_payloads, database, payloads)
        self.read_clock_reference = partial(read_clock_reference, database)
        self.write_clock_reference = partial(write_clock_reference, database)
        self.read_note, self.write_note = partial(read_note, database), partial(write_note, database)
        self.statistics = partial(statistics, database)
        self.extents = partial(extents, database)
        self.origins = partial(origins, database)
        self.footprints = partial(footprints, database)
        self.frame_names = partial(frame_names, database)
        self.pose_graph = partial(pose_graphs.read, database)
        self.pose_graph_nodes = partial(pose_graphs.nodes_between, database)

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def watch(self, *, takes_lease: bool = False) -> CommitWatch:
        """Return a watch that calls a function after the commits of all processes.

        The caller closes the watch before the store. A process that takes the lease maintains the store: it
        records samples, retires products and publishes events.
        """
        return self._database.dialect.watch(self._database.engine, takes_lease=takes_lease)

    def close(self) -> None:
        """Close the database and release the directory for another process."""
        self.pyramid.close()
        self.maps.patches.close()
        self._opened.close()


def _without_database(directory: Path) -> str:
    return (
        f"data directory {directory}: payloads of products, but no database that names them: run `cdff dpm "
        "rebuild`, or restore a backup into another directory; --new creates an empty database"
    )


def in_use(directory: Path, holder: str) -> str:
    """Return the reason why another process cannot open a store."""
    return f"data directory {directory}: in use by process {holder}; only one DPM opens it at a time"
