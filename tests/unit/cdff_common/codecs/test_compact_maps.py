# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of few observed cells: compact as UPER, whole in memory, every bit preserved."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdff_common.codecs import CODECS, MAX_EXPANSION, decode, encode, uper
from cdff_common.codecs.compact_maps import compact, expanded
from cdff_common.errors import CodecError, InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap, GridLayer, NavigationMap

ROWS, COLUMNS = 40, 50


def sparse_map(kind: type, fraction: float, rng: np.random.Generator) -> Any:
    """Return a map of three layers, of which a fraction of the cells is observed."""
    observed = rng.random((ROWS, COLUMNS)) < fraction
    layers: dict[str, np.ndarray] = {
        "mean": np.where(observed, rng.normal(size=observed.shape), np.nan).astype(np.float32),
        "variance": np.where(observed, rng.random(observed.shape), np.nan),
        "kind": np.where(observed, rng.integers(0, 200, observed.shape), 7).astype(np.uint8),
    }
    geometry = GridGeometry("site", 0.05, -1.0, 1.0, ROWS, COLUMNS)
    return kind.from_layers(geometry, layers, t0_ns=1000, t1_ns=2000)  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", [ElevationMap, NavigationMap])
@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.6, 1.0])
def test_a_decoded_map_has_every_bit_of_the_encoded_one(
    kind: type, codec: str, fraction: float, rng: np.random.Generator
) -> None:
    value = sparse_map(kind, fraction, rng)
    decoded = decode(kind.__name__, encode(value, codec), codec)
    assert decoded.layer_names == ("mean", "variance", "kind")
    assert decoded.metadata == value.metadata
    assert all(np.array_equal(a.data, b.data) for a, b in zip(value.layers, decoded.layers, strict=True))
    assert [layer.depth for layer in decoded.layers] == [layer.depth for layer in value.layers]


def test_a_map_of_few_cells_is_written_in_a_fraction_of_its_size(rng: np.random.Generator) -> None:
    value = sparse_map(ElevationMap, 0.1, rng)
    whole, written = uper.encode(value), encode(value)
    observed = np.count_nonzero(np.isfinite(value.layer("mean")))
    assert len(written) < len(whole) / 7
    assert abs(len(written) - (ROWS * COLUMNS // 8 + 13 * observed)) < 200
    assert encode(value, "msgpack") != encode(compact(value), "msgpack"), "only UPER is compact"


def test_a_map_of_many_cells_is_written_as_it_is(rng: np.random.Generator) -> None:
    value = sparse_map(ElevationMap, 0.9, rng)
    assert compact(value) is value
    assert encode(value) == uper.encode(value)


def test_whole_layers_of_earlier_versions_are_read(rng: np.random.Generator) -> None:
    value = sparse_map(ElevationMap, 0.1, rng)
    assert decode("ElevationMap", uper.encode(value)) == value


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 9), columns=st.integers(1, 9))
def test_any_bits_are_preserved(seed: int, rows: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    words = np.array([0x7FC00000, 0xFFC00001, 0x80000000, 0, 0x3F800000], np.uint32)
    chances = [0.8, *[0.05] * 4]
    layers = {
        name: rng.choice(words, (rows, columns), p=chances).view(np.float32) for name in ("mean", "variance")
    }
    value = ElevationMap.from_layers(
        GridGeometry("site", 0.05, 0.0, 0.0, rows, columns), layers, t0_ns=0, t1_ns=0
    )
    decoded = expanded(compact(value))
    assert all(np.array_equal(a.data, b.data) for a, b in zip(value.layers, decoded.layers, strict=True))


def test_a_map_of_one_value_is_decoded_without_unbounded_memory() -> None:
    geometry = GridGeometry("site", 0.05, 0.0, 0.0, 1000, 1000)
    layers = {f"layer{i}": np.zeros((1000, 1000)) for i in range(20)}
    value = ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)
    assert compact(value) is value, "its layers would expand by more than the limit"
    bits = np.zeros(125_000, np.uint8)
    bomb = ElevationMap(
        value.metadata,
        (
            GridLayer.from_array("observed_cells", bits),
            *(GridLayer.from_array(f"layer{i}", np.zeros(1)) for i in range(20)),
        ),
    )
    least = -(-20 * 8_000_000 // MAX_EXPANSION)
    with pytest.raises(CodecError, match=f"20 layers in 125160 bytes: expected at least {least}"):
        decode("ElevationMap", uper.encode(bomb))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda bits, cells: (bits[:-1], cells), "249 bytes of uint8, expected 250 of uint8"),
        (lambda bits, cells: (bits, cells[:-1]), "'mean': 800 bytes, expected 804 for 200 observed cells"),
        (lambda bits, cells: (bits.view(np.int8), cells), "250 bytes of int8, expected 250 of uint8"),
    ],
)
def test_compact_maps_of_wrong_lengths_are_refused(
    change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], message: str
) -> None:
    metadata = sparse_map(ElevationMap, 0.1, np.random.default_rng(1)).metadata
    bits, cells = change(np.packbits(np.arange(ROWS * COLUMNS) % 10 == 0), np.zeros(201, np.float32))
    with pytest.raises(InputError, match=message):
        ElevationMap(
            metadata, (GridLayer.from_array("observed_cells", bits), GridLayer.from_array("mean", cells))
        )


def test_the_name_of_the_compact_form_is_refused_for_a_layer() -> None:
    geometry = GridGeometry("site", 0.05, 0.0, 0.0, 2, 2)
    with pytest.raises(InputError, match="'observed_cells': expected another name"):
        ElevationMap.from_layers(geometry, {"observed_cells": np.zeros((2, 2))}, t0_ns=0, t1_ns=0)
