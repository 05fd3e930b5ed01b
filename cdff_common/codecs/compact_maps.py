# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compact form of elevation and navigation maps: the layers contain the values of observed cells only.

The first layer of a map in this form is named ``observed_cells``. Its bytes are one bit per cell, 1 where the
cell is observed, row-major, the first cell in the highest bit. Each other layer contains first its value in
all unobserved cells, then its values in the observed cells, row-major. The conversion preserves every bit.
``encode`` writes maps in this form as UPER if it is clearly smaller; ``decode`` returns the whole layers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs import MAX_EXPANSION
from cdff_common.errors import CodecError

#: A map is compacted if this makes it smaller than the fraction.
_WORTHWHILE = 0.75


def compact(value: Any) -> Any:
    """Return a map in its compact form, or unchanged if the compact form is not clearly smaller.

    Parameters
    ----------
    value : ElevationMap or NavigationMap
        Map with whole layers.
    """
    from cdff_common.types import GridLayer
    from cdff_common.types.map_ext import OBSERVED_CELLS

    layers = [_cells(layer) for layer in value.layers]
    if not layers or not layers[0].size:
        return value
    missing = _missing_value(value.layers[0], layers[0])
    unobserved_cell = int(np.argmax(layers[0] == missing))
    is_observed = layers[0] != layers[0][unobserved_cell]
    for cells in layers[1:]:
        is_observed |= cells != cells[unobserved_cell]
    observed = np.flatnonzero(is_observed)
    bits = np.packbits(is_observed)
    compact_bytes = len(bits) + sum((len(observed) + 1) * cells.itemsize for cells in layers)
    whole_bytes = sum(cells.nbytes for cells in layers)
    is_smaller = compact_bytes < _WORTHWHILE * whole_bytes
    if not is_smaller or whole_bytes > MAX_EXPANSION * compact_bytes:
        return value
    indices = np.concatenate([[unobserved_cell], observed])
    depth = GridLayer.from_array(OBSERVED_CELLS, bits).depth
    return type(value)(
        value.metadata,
        (
            GridLayer(OBSERVED_CELLS, depth, bits),
            *(
                GridLayer(layer.name, layer.depth, cells[indices].view(np.uint8))
                for layer, cells in zip(value.layers, layers, strict=True)
            ),
        ),
    )


def expanded(value: Any) -> Any:
    """Return a map with whole layers.

    Parameters
    ----------
    value : ElevationMap or NavigationMap
        Map in either form.

    Raises
    ------
    CodecError
        If the whole layers have more than 64 times the bytes of the compact ones.
    """
    from cdff_common.types import GridLayer

    if not value.is_compact:
        return value
    rows, columns = value.metadata.rows, value.metadata.cols
    bits, *layers = value.layers
    arrays = [_cells(layer) for layer in layers]
    whole_bytes = sum(rows * columns * cells.itemsize for cells in arrays)
    compact_bytes = len(bits.data) + sum(cells.nbytes for cells in arrays)
    if whole_bytes > MAX_EXPANSION * compact_bytes:
        raise CodecError(
            f"{type(value).__name__} of {rows} x {columns} cells with {len(layers)} layers in "
            f"{compact_bytes} bytes: expected at least {-(-whole_bytes // MAX_EXPANSION)}"
        )
    observed = np.flatnonzero(np.unpackbits(bits.data, count=rows * columns))
    whole = []
    for layer, cells in zip(layers, arrays, strict=True):
        array = np.full(rows * columns, cells[0], cells.dtype)
        array[observed] = cells[1:]
        whole.append(GridLayer(layer.name, layer.depth, array.view(np.uint8)))
    return type(value)(value.metadata, tuple(whole))


def _cells(layer: Any) -> NDArray[Any]:
    """Return the elements of a layer as unsigned integers, so that comparisons concern all bits."""
    return layer.data.view(f"<u{layer.dtype.itemsize}")  # type: ignore[no-any-return]


def _missing_value(layer: Any, cells: NDArray[Any]) -> Any:
    """Return the bits of NaN, or 0 in layers of integers."""
    value = np.array([np.nan if layer.dtype.kind == "f" else 0], layer.dtype)
    return value.view(cells.dtype)[0]
