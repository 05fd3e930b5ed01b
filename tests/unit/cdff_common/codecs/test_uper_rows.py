# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lists of messages that contain only REALs: compiled loops give the encoding of single messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import decode, reference, uper
from cdff_common.codecs.uper_rows import LONG, widths
from cdff_common.errors import CodecError
from cdff_common.types.schema_table import MESSAGES
from tests.support.messages import REALS, random_message


def _pairs(n: int, rng: np.random.Generator) -> types.CorrespondenceMap2D:
    return types.CorrespondenceMap2D.from_arrays(
        rng.choice(REALS, (n, 2)), rng.normal(size=(n, 2)), rng.uniform(size=n)
    )


def _joints(n: int, rng: np.random.Generator) -> types.JointTrajectory:
    return types.JointTrajectory(tuple(random_message("JointState", rng) for _ in range(n)))


@pytest.mark.slow
@pytest.mark.parametrize("make", [_pairs, _joints])
@pytest.mark.parametrize("n", [1, LONG - 1, LONG, LONG + 1, 60])
def test_long_lists_are_encoded_like_short_ones(make: Any, n: int, rng: np.random.Generator) -> None:
    value = make(n, rng)
    name, data = type(value).ASN1_NAME, uper.encode(value)
    assert decode(name, data) == value
    assert reference.decode(name, data, "uper") == value
    assert uper.decode(name, reference.encode(value, "uper")) == value


def test_lists_in_fragments_are_read(rng: np.random.Generator) -> None:
    value = _pairs(70_000, rng)
    assert decode("CorrespondenceMap2DLarge", uper.encode(value)) == value


def test_decoded_arrays_are_contiguous_and_read_only(rng: np.random.Generator) -> None:
    decoded = decode("CorrespondenceMap2D", uper.encode(_pairs(40, rng)))
    for item in decoded.items:
        assert item.source.flags.c_contiguous
        assert not item.source.flags.writeable
        assert type(item.probability) is float
        assert item == types.Correspondence2D(item.source, item.sink, item.probability)


def test_a_truncated_list_is_refused(rng: np.random.Generator) -> None:
    data = uper.encode(_pairs(40, rng))
    with pytest.raises(CodecError, match="CorrespondenceMap2D as uper"):
        decode("CorrespondenceMap2D", data[:-30])


def test_only_messages_of_fixed_size_reals_use_the_fast_path() -> None:
    assert widths(MESSAGES["Correspondence3D"]) == [("source", (3,)), ("sink", (3,)), ("probability", None)]
    assert widths(MESSAGES["Pose"]) == [("pos", (3,)), ("orient", (4,))]
    for name in ("VisualPointFeature2D", "Time", "Wrench", "VisualPointFeature3D"):
        assert widths(MESSAGES[name]) is None
