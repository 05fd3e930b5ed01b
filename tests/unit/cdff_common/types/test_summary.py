# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Short text and HTML of messages."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common import types
from cdff_common.raster import GridGeometry
from cdff_common.types.summary import brief


def elevation_map() -> types.ElevationMap:
    geometry = GridGeometry("site", 0.1, 0.0, 10.0, 100, 100)
    heights = np.linspace(-1.5, 2.0, 10_000, dtype=np.float32).reshape(100, 100)
    layers = {"mean": heights, "variance": np.full((100, 100), np.nan, np.float32)}
    return types.ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)


def test_a_map_has_the_range_of_each_layer() -> None:
    text = repr(elevation_map())
    assert "GridLayer('mean', <float32 (10000,) -1.5..2>)" in text
    assert "GridLayer('variance', <float32 (10000,) none finite>)" in text
    assert len(text) < 500


def test_an_array_has_dtype_shape_and_range() -> None:
    values = np.arange(40.0)
    values[3] = np.nan
    assert brief(values) == "<float64 (40,) 0..39, 1 not finite>"
    assert brief(np.arange(3)) == "[0, 1, 2]"


MESSAGES = sorted(n for n in types.__all__ if getattr(getattr(types, n), "ASN1_NAME", ""))


@pytest.mark.parametrize("name", MESSAGES)
def test_the_repr_and_the_html_of_a_default_value_are_short(name: str) -> None:
    type_ = getattr(types, name)
    try:
        value = type_()
    except TypeError:
        pytest.skip("has no default value")
    assert len(repr(value)) < 4000
    assert value._repr_html_().startswith(f"<div><b>{name}</b>")


def test_a_long_tuple_is_its_length() -> None:
    frames = types.FramesSequence(tuple(types.Frame() for _ in range(1000)))
    assert repr(frames) == "FramesSequence(items=<1000 x Frame>)"


def test_html_is_escaped_and_has_the_content_in_words() -> None:
    html = elevation_map()._repr_html_()
    assert "100 x 100 cells of 0.1 m in site" in html
    assert "&lt;float32" in html


def test_a_time_is_a_datetime() -> None:
    assert types.Time.from_ns(1_500_000_000).to_datetime().isoformat() == "1970-01-01T00:00:01.500000+00:00"
