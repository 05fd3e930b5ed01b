# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import errno
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import CdffError, CodecError, InputError
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.types import Time
from services.dfpc_host.keeping import Activity, Keeper, state_file


class Remembering(Dfpc):
    """A DFPC whose state is a time."""

    name = "remembering"

    def __init__(self) -> None:
        self.now: Time | None = None

    def setup(self) -> None:
        self.now = None

    def reset(self) -> None:
        self.setup()

    def step(self, sample: Any) -> Any:
        self.now = sample
        self.state_revision += 1
        return ()

    def state(self) -> Time | None:
        return self.now

    def resume(self, state: Any) -> None:
        if not isinstance(state, Time):
            raise InputError(f"state {type(state).__name__}, expected Time")
        self.now = state


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "dfpc" / "mana" / "remembering.state"


def kept(path: Path, ns: int = 5_000) -> Remembering:
    node = Remembering()
    keeper = Keeper(path, period_s=0.0)
    keeper.give_back(node)
    node.step(Time.from_ns(ns))
    keeper.keep(node)
    return node


@pytest.mark.req("CDFF-CORE-077")
def test_what_was_kept_is_given_back_to_the_next_process(path: Path) -> None:
    kept(path)
    node = Remembering()
    Keeper(path).give_back(node)
    assert node.now is not None
    assert node.now.ns == 5_000


def test_nothing_is_written_while_nothing_changes(path: Path) -> None:
    node = Remembering()
    keeper = Keeper(path, period_s=0.0)
    keeper.give_back(node)
    keeper.keep(node, now=True)
    assert not path.exists()


def test_the_first_state_is_saved_at_once_then_once_a_period_and_when_it_ends(path: Path) -> None:
    node = Remembering()
    keeper = Keeper(path, period_s=3600.0)
    keeper.give_back(node)
    keeper.keep_first(node)
    assert not path.exists()  # nothing to be kept yet
    node.step(Time.from_ns(1_000))
    keeper.keep_first(node)
    first = path.read_bytes()
    node.step(Time.from_ns(2_000))
    keeper.keep_first(node)
    keeper.keep(node)
    assert path.read_bytes() == first
    keeper.keep(node, now=True)
    assert path.read_bytes() != first


def test_a_young_state_is_saved_more_often(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("services.dfpc_host.keeping.monotonic_s", lambda: now_s)
    node, keeper, saved_s = Remembering(), Keeper(path), list[float]()
    keeper.give_back(node)
    for tick in range(400):
        now_s = 100.0 + 0.1 * tick
        before = path.read_bytes() if path.exists() else b""
        node.step(Time.from_ns(1_000 * (tick + 1)))
        keeper.keep(node)
        if path.read_bytes() != before:
            saved_s.append(round(now_s - 100.0, 1))
    gaps_s = [round(b - a, 1) for a, b in itertools.pairwise(saved_s)]
    np.testing.assert_allclose(gaps_s, [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0], atol=0.11)


@pytest.mark.req("CDFF-SUP-194")
def test_that_a_dfpc_is_active_outlives_its_process(tmp_path: Path) -> None:
    path = tmp_path / "dfpc" / "mana" / "slam.active"
    assert Activity(path).left() is None
    Activity(path).keep({"scan": "sensor/lidar/scan"})
    assert Activity(path).left() == {"scan": "sensor/lidar/scan"}
    path.write_text("[1")
    assert Activity(path).left() is None
    Activity(path).end()
    Activity(path).end()
    assert not path.exists()


def test_a_state_that_was_forgotten_is_forgotten_on_disk(path: Path) -> None:
    node = kept(path)
    keeper = Keeper(path, period_s=0.0)
    keeper.give_back(node)
    node.now = None
    node.state_revision += 1
    keeper.keep(node)
    assert not path.exists()


def full(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("forgotten", [False, True])
def test_a_disk_that_cannot_be_written_is_said_and_tried_again(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, forgotten: bool
) -> None:
    node = kept(path)
    keeper = Keeper(path, period_s=0.0)
    keeper.give_back(node)
    node.step(None if forgotten else Time.from_ns(6_000))
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink" if forgotten else "open", full)
        keeper.keep(node, now=True)
    assert "No space left on device" in caplog.text
    assert path.read_bytes() == before
    keeper.keep(node)
    assert not path.exists() if forgotten else path.read_bytes() != before


def test_activity_that_cannot_be_removed_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Path, "unlink", full)
    Activity(tmp_path / "slam.active").end()
    assert "is not removed" in caplog.text


@pytest.mark.parametrize(
    "damage", [lambda d: d[:-1], lambda d: d[:-1] + b"\xff", lambda d: b"", lambda d: b"\x00" * 99]
)
def test_a_damaged_file_is_put_aside_and_said(path: Path, damage: Any) -> None:
    kept(path)
    path.write_bytes(damage(path.read_bytes()))
    node = Remembering()
    with pytest.raises(CodecError, match="SHA-256"):
        Keeper(path).give_back(node)
    assert node.now is None
    assert not path.exists()
    assert path.with_suffix(".broken").exists()


def test_a_damaged_file_that_cannot_be_put_aside_is_not_resumed_in_part(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept(path)
    monkeypatch.setattr(Path, "replace", full)

    class Half(Remembering):
        def resume(self, state: Any) -> None:
            self.now = state
            raise InputError("the rest is missing")

    node = Half()
    with pytest.raises(OSError, match="No space left"):
        Keeper(path).give_back(node)
    assert node.now is None


def test_a_state_that_the_dfpc_does_not_take_is_put_aside(path: Path) -> None:
    kept(path)

    class Other(Remembering):
        def resume(self, state: Any) -> None:
            raise InputError("not mine")

    with pytest.raises(CdffError, match="not mine"):
        Keeper(path).give_back(Other())
    assert path.with_suffix(".broken").exists()


def test_a_save_that_was_cut_short_leaves_the_one_before(path: Path) -> None:
    kept(path, ns=7_000)
    path.with_suffix(".part").write_bytes(b"half of")
    node = Remembering()
    Keeper(path).give_back(node)
    assert node.now is not None
    assert node.now.ns == 7_000


def test_the_file_lies_in_the_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CDFF_DATA_DIR", str(tmp_path))
    assert state_file("mana", "lidar_slam") == tmp_path / "dfpc" / "mana" / "lidar_slam.state"
