# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Blocks of pooled elevation cells: a window over ground with many patches reads only those that are new.

The cells of windows with the same frame and cell size are the same, whatever their regions are. They are
pooled in square blocks, which stay in memory with the patches that they contain, and a window is copied from
its blocks. Before that, a search finds the patches of the blocks: missing ones are added, and a block with a
patch that was deleted or moved is pooled again. Only windows of the present state use blocks.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cdff_common.clock import monotonic_s
from cdff_common.errors import OverloadedError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from cdff_common.raster.cell_selection import Choice, Disagreement
from dpm_store.maps.patches import Patches, PatchSelection, bounds_each
from dpm_store.maps.windows import PatchUsage, WindowQuery
from dpm_store.products.records import ProductRecord

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry
    from cdff_common.raster.mosaic import AssembledWindow, Mosaic

#: Edge of a block, cells.
EDGE_CELLS = 128
#: Size of all blocks in memory, and of the blocks of one window, bytes.
CACHE_BYTES, WINDOW_BYTES = 48 << 20, 40 << 20
#: Windows with more patches than this are not pooled in blocks, which have more patches than the window.
MAX_PATCHES = 4_000
#: Bytes of a cell: height statistics, their auxiliary layers, and the same again if the newest are kept.
_CELL_BYTES, _NEWEST_CELL_BYTES = 112, 104
#: Blocks that no window has used for longer than this are dropped, seconds.
IDLE_S = 8.0
#: Longest wait of a window for others that pool the same blocks, seconds.
_WAIT_S = 8.0


class BlockKey(NamedTuple):
    """Place and rules of a block; ``column`` and ``row`` count blocks from the frame's origin."""

    frame: str
    resolution_m: float
    robot: str | None
    choice: Choice
    disagreement: Disagreement
    column: int
    row: int

    @property
    def geometry(self) -> GridGeometry:
        """Cells of the block."""
        from cdff_common.raster import GridGeometry

        return GridGeometry.from_cells(
            self.frame,
            self.resolution_m,
            left=self.column * EDGE_CELLS,
            top=(self.row + 1) * EDGE_CELLS,
            rows=EDGE_CELLS,
            cols=EDGE_CELLS,
        )

    @property
    def nbytes(self) -> int:
        """Memory of the block."""
        newest = _NEWEST_CELL_BYTES if self.disagreement is Disagreement.NEWEST else 0
        return EDGE_CELLS**2 * (_CELL_BYTES + newest)


@dataclass(frozen=True, slots=True)
class PooledPatch:
    """A patch in a block: the cells that it can have there (None for none), and whether it is resampled."""

    cells: GridGeometry | None
    is_resampled: bool


@dataclass(slots=True, eq=False)
class Block:
    """Pooled cells, their patches by id, ``T_window_frame`` of their frames, and the time of the last use."""

    key: BlockKey
    mosaic: Mosaic
    patches: dict[str, PooledPatch] = field(default_factory=dict)
    transforms: dict[str, UncertainTransform] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)
    used_s: float = 0.0

    @classmethod
    def empty(cls, key: BlockKey) -> Block:
        """Return a block without patches."""
        from cdff_common.raster.mosaic import Mosaic

        return cls(key, Mosaic(key.geometry, key.choice, key.disagreement, auxiliary=True))

    def clear(self) -> None:
        """Remove all patches."""
        fresh = Block.empty(self.key)
        self.mosaic, self.patches, self.transforms = fresh.mosaic, {}, {}

    def is_valid_for(self, selection: PatchSelection, ids: set[str]) -> bool:
        """Return whether all patches of the block are still there, and at the same place."""
        return self.patches.keys() <= ids and all(
            frame in selection.transforms and T.equals(selection.transforms[frame])
            for frame, T in self.transforms.items()
        )


class PooledBlocks:
    """Blocks of pooled cells in memory.

    Beyond ``CACHE_BYTES`` the least recently used are dropped, and by ``drop_idle`` those that are not used.
    """

    def __init__(self, patches: Patches) -> None:
        self._patches = patches
        self._lock = threading.Lock()
        self._blocks: OrderedDict[BlockKey, Block] = OrderedDict()
        self._bytes = 0

    def pool(
        self, query: WindowQuery, selection: PatchSelection, geometry: GridGeometry
    ) -> tuple[AssembledWindow, PatchUsage] | None:
        """Return the pooled cells of a grid with their patches; None if no blocks can be used.

        Parameters
        ----------
        query : WindowQuery
            A choice of cells by robot is not possible.
        selection : PatchSelection
            Patches in the region of the query.
        geometry : GridGeometry
            Aligned cells in the query's frame.

        Raises
        ------
        OverloadedError
            If other windows pool the same blocks for too long, or the time of the request is over. The
            patches read so far stay in the blocks.
        """
        if any(v is not None for v in (query.t0_ns, query.t1_ns, query.as_of_ns, query.frames_revision)):
            return None
        keys = list(_keys(query, geometry))
        if sum(key.nbytes for key in keys) > WINDOW_BYTES or len(selection.records) > MAX_PATCHES:
            return None
        with self._locked(keys) as blocks:
            patches_of_blocks = self._patches.find(query.search(_region_of(blocks)))
            usage = self._update(blocks, patches_of_blocks)
            return self._assemble(query, geometry, blocks, usage, selection, patches_of_blocks)

    def drop_idle(self) -> bool:
        """Drop the blocks that were not used for ``IDLE_S``; return whether there were any."""
        with self._lock:
            before, limit_s = len(self._blocks), monotonic_s() - IDLE_S
            while self._blocks and next(iter(self._blocks.values())).used_s < limit_s:
                self._drop_oldest()
            return len(self._blocks) < before

    @contextmanager
    def _locked(self, keys: Sequence[BlockKey]) -> Iterator[list[Block]]:
        """Lock the blocks of ascending keys, so that no two windows wait for each other."""
        with self._lock:
            blocks = [self._block(key) for key in keys]
        deadline_s = monotonic_s() + _WAIT_S
        with ExitStack() as stack:
            for block in blocks:
                if not block.lock.acquire(timeout=max(deadline_s - monotonic_s(), 0.0)):
                    raise OverloadedError(
                        f"other windows have pooled the same maps for {_WAIT_S:g} s; try again", _WAIT_S
                    )
                stack.callback(block.lock.release)
            yield blocks

    def _block(self, key: BlockKey) -> Block:
        """Return the block of a key from the cache, or an empty one; the least recently used blocks are
        dropped.
        """
        block = self._blocks.get(key)
        if block is None:
            block = self._blocks[key] = Block.empty(key)
            self._bytes += key.nbytes
        block.used_s = monotonic_s()
        self._blocks.move_to_end(key)
        while self._bytes > CACHE_BYTES:
            self._drop_oldest()
        return block

    def _drop_oldest(self) -> None:
        """Drop the block whose last use is longest ago; the lock is held."""
        key, _ = self._blocks.popitem(last=False)
        self._bytes -= key.nbytes

    def _update(self, blocks: Sequence[Block], patches_of_blocks: PatchSelection) -> PatchUsage:
        """Add the missing patches to blocks; return the frames and patches that cannot be pooled."""
        from cdff_common.raster.mosaic import fitting_factor, is_level

        first = blocks[0].key
        tilted = {frame for frame, T in patches_of_blocks.transforms.items() if not is_level(T)}
        finest_m = first.resolution_m * (1.0 + 1e-9)
        is_usable = np.array(
            [
                r.header.frame not in tilted and self._patches.resolution_m(r) <= finest_m
                for r in patches_of_blocks.records
            ],
            dtype=np.bool_,
        )
        boxes = bounds_each(patches_of_blocks, first.frame)
        missing: dict[str, list[Block]] = {}
        for block in blocks:
            b = block.mosaic.geometry.bounds
            near = (boxes[:, 0] <= b.xmax) & (boxes[:, 2] >= b.xmin)
            near &= (boxes[:, 1] <= b.ymax) & (boxes[:, 3] >= b.ymin) & is_usable
            ids = {patches_of_blocks.records[i].id for i in np.flatnonzero(near)}
            if not block.is_valid_for(patches_of_blocks, ids):
                block.clear()
            for product_id in ids - block.patches.keys():
                missing.setdefault(product_id, []).append(block)
        purged = set()
        for record, patch in self._patches.read([r for r in patches_of_blocks.records if r.id in missing]):
            if patch is None:
                purged.add(record.id)
                continue
            T = patches_of_blocks.transforms.get(record.header.frame)
            for block in missing[record.id]:
                if T is not None:
                    block.transforms[record.header.frame] = T
                cells = block.mosaic.add(patch.geometry, patch.layers, patch.t1_ns, T)
                is_resampled = fitting_factor(patch.geometry, block.mosaic.geometry) is None
                block.patches[record.id] = PooledPatch(cells, is_resampled)
        return PatchUsage([], skipped_frames=tuple(sorted(tilted)), purged_ids=frozenset(purged))

    def _assemble(
        self,
        query: WindowQuery,
        geometry: GridGeometry,
        blocks: Sequence[Block],
        usage: PatchUsage,
        selection: PatchSelection,
        patches_of_blocks: PatchSelection,
    ) -> tuple[AssembledWindow, PatchUsage]:
        """Return the window assembled from blocks, and the patches that contribute to it."""
        from cdff_common.raster.mosaic import Mosaic

        mosaic = Mosaic(geometry, query.choice, query.disagreement, auxiliary=True)
        pooled: dict[str, bool] = {}
        for block in blocks:
            mosaic.copy_cells(block.mosaic)
            for product_id, patch in block.patches.items():
                if patch.cells is not None and patch.cells.intersection(geometry) is not None:
                    pooled[product_id] = patch.is_resampled
        records = [r for r in _in_region(patches_of_blocks, selection) if r.id in pooled]
        assembled = mosaic.assembled()
        return assembled, replace(
            usage,
            records=records,
            disagreeing=assembled.disagreeing,
            resampled_ids=frozenset(r.id for r in records if pooled[r.id]),
        )


def _keys(query: WindowQuery, geometry: GridGeometry) -> Iterator[BlockKey]:
    """Yield the keys of the blocks with cells of a grid, ascending."""
    right, bottom = geometry.left + geometry.cols, geometry.top - geometry.rows
    for column in range(geometry.left // EDGE_CELLS, (right - 1) // EDGE_CELLS + 1):
        for row in range(bottom // EDGE_CELLS, (geometry.top - 1) // EDGE_CELLS + 1):
            yield BlockKey(
                geometry.frame,
                geometry.resolution_m,
                query.robot,
                query.choice,
                query.disagreement,
                column,
                row,
            )


def _region_of(blocks: Sequence[Block]) -> Region:
    """Return the rectangle of blocks."""
    bounds = np.array([block.mosaic.geometry.bounds for block in blocks])
    return Region("bbox", (*bounds[:, :2].min(axis=0).tolist(), *bounds[:, 2:].max(axis=0).tolist()))


def _in_region(patches_of_blocks: PatchSelection, selection: PatchSelection) -> Iterator[ProductRecord]:
    """Yield the found patches that are in the region of a selection or were inserted after its search."""
    ids = {record.id for record in selection.records}
    last = max(record.ordinal for record in selection.records)
    return (r for r in patches_of_blocks.records if r.id in ids or r.ordinal > last)
