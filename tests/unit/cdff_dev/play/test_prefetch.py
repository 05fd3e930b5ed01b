# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples are encoded ahead of their time, in order, within a bounded buffer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from cdff_common.codecs import decode
from cdff_common.errors import CodecError, InputError
from cdff_common.interfaces.product import Header
from cdff_common.types import Frame
from cdff_dev.logs import LogSample
from cdff_dev.logs.source import split_stream
from cdff_dev.play.prefetch import Prefetch, item_of


def sample(i: int, stream: str = "/mana/navcam.image") -> LogSample:
    image = np.full((64, 64), i % 256, dtype=np.uint8)
    stamp_ns = i * 1_000_000
    return LogSample(stream, "Frame", stamp_ns, i, Frame.from_image(image, stamp_ns=stamp_ns), None)


def test_items_are_ordered_with_key_bytes_and_header() -> None:
    items = list(Prefetch([sample(i) for i in range(5)], lambda robot, sensor: True))
    assert [i.stamp_ns for i in items] == [i * 1_000_000 for i in range(5)]
    assert items[3].key == "cdff/@v1/mana/sensor/navcam/image"
    assert items[3].encoding == "application/vnd.cdff+uper;Frame/1"
    assert decode("Frame", items[3].encoded(), "uper").image[0, 0] == 3
    assert Header.from_attachment(items[3].attachment).seq == 3


def test_samples_of_a_sensor_that_is_off_are_encoded_only_on_request() -> None:
    (item,) = Prefetch([sample(1)], lambda robot, sensor: False)
    assert item.payload is None
    assert item.encoded() == item_of(sample(1)).encoded()


def test_the_buffer_stays_within_its_capacity() -> None:
    numbers_read = []

    def source() -> Iterator[LogSample]:
        for i in range(50):
            numbers_read.append(i)
            yield sample(i)

    prefetch = Prefetch(source(), lambda robot, sensor: True, capacity_bytes=20_000)
    prefetch.wait_filled(10**12, 10.0)
    assert 2 <= len(numbers_read) <= 8
    prefetch.close()


def test_closing_ends_the_reading_of_a_long_log() -> None:
    prefetch = Prefetch((sample(i) for i in range(10**6)), lambda robot, sensor: True, capacity_bytes=10_000)
    prefetch.close()
    assert not prefetch._thread.is_alive()


def test_errors_of_reading_are_raised_in_order() -> None:
    def source() -> Iterator[LogSample]:
        yield sample(0)
        raise CodecError("chunk 2 is broken")

    items = iter(Prefetch(source(), lambda robot, sensor: True))
    assert next(items).stamp_ns == 0
    with pytest.raises(CodecError, match="chunk 2"):
        next(items)


@pytest.mark.parametrize("stream", ["mana/navcam.pair", "/mana", "/mana/navcam", "/mana/a/b.c"])
def test_a_stream_of_another_form_is_refused(stream: str) -> None:
    with pytest.raises(InputError, match=r"expected /robot/sensor\.stream"):
        split_stream(stream)
