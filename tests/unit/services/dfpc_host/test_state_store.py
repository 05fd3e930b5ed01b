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
from services.dfpc_host.state_store import ActivityRecord, StateStore, state_file


class LastTimeDfpc(Dfpc):
    """A DFPC whose state is a time."""

    name = "last_time"

    def __init__(self) -> None:
        self.last_time: Time | None = None

    def setup(self) -> None:
        self.last_time = None

    def reset(self) -> None:
        self.setup()

    def step(self, sample: Any) -> Any:
        self.last_time = sample
        self.state_revision += 1
        return ()

    def state(self) -> Time | None:
        return self.last_time

    def resume(self, state: Any) -> None:
        if not isinstance(state, Time):
            raise InputError(f"state {type(state).__name__}, expected Time")
        self.last_time = state


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "dfpc" / "mana" / "last_time.state"


def node_with_saved_state(path: Path, ns: int = 5_000) -> LastTimeDfpc:
    node = LastTimeDfpc()
    store = StateStore(path, period_s=0.0)
    store.restore(node)
    node.step(Time.from_ns(ns))
    store.checkpoint(node)
    return node


@pytest.mark.req("CDFF-CORE-077")
def test_the_state_is_restored_in_the_next_process(path: Path) -> None:
    node_with_saved_state(path)
    node = LastTimeDfpc()
    StateStore(path).restore(node)
    assert node.last_time is not None
    assert node.last_time.ns == 5_000


def test_an_unchanged_state_is_not_written(path: Path) -> None:
    node = LastTimeDfpc()
    store = StateStore(path, period_s=0.0)
    store.restore(node)
    store.checkpoint(node, now=True)
    assert not path.exists()


def test_the_first_state_is_saved_at_once_and_later_ones_periodically_and_at_the_end(path: Path) -> None:
    node = LastTimeDfpc()
    store = StateStore(path, period_s=3600.0)
    store.restore(node)
    store.checkpoint_first(node)
    assert not path.exists()  # the state did not change yet
    node.step(Time.from_ns(1_000))
    store.checkpoint_first(node)
    first_saved = path.read_bytes()
    node.step(Time.from_ns(2_000))
    store.checkpoint_first(node)
    store.checkpoint(node)
    assert path.read_bytes() == first_saved
    store.checkpoint(node, now=True)
    assert path.read_bytes() != first_saved


def test_the_interval_between_saves_grows_after_a_start(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("services.dfpc_host.state_store.monotonic_s", lambda: now_s)
    node, store, saved_s = LastTimeDfpc(), StateStore(path), list[float]()
    store.restore(node)
    for tick in range(400):
        now_s = 100.0 + 0.1 * tick
        previously_saved = path.read_bytes() if path.exists() else b""
        node.step(Time.from_ns(1_000 * (tick + 1)))
        store.checkpoint(node)
        if path.read_bytes() != previously_saved:
            saved_s.append(round(now_s - 100.0, 1))
    intervals_s = [round(b - a, 1) for a, b in itertools.pairwise(saved_s)]
    np.testing.assert_allclose(intervals_s, [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0], atol=0.11)


@pytest.mark.req("CDFF-SUP-194")
def test_the_activation_survives_a_restart_of_the_process(tmp_path: Path) -> None:
    path = tmp_path / "dfpc" / "mana" / "slam.active"
    assert ActivityRecord(path).read() is None
    ActivityRecord(path).write({"scan": "sensor/lidar/scan"})
    assert ActivityRecord(path).read() == {"scan": "sensor/lidar/scan"}
    path.write_text("[1")
    assert ActivityRecord(path).read() is None
    ActivityRecord(path).remove()
    ActivityRecord(path).remove()
    assert not path.exists()


def test_a_cleared_state_is_removed_from_disk(path: Path) -> None:
    node = node_with_saved_state(path)
    store = StateStore(path, period_s=0.0)
    store.restore(node)
    node.last_time = None
    node.state_revision += 1
    store.checkpoint(node)
    assert not path.exists()


def disk_full(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("cleared", [False, True])
def test_a_failed_write_or_removal_is_reported_and_repeated(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, cleared: bool
) -> None:
    node = node_with_saved_state(path)
    store = StateStore(path, period_s=0.0)
    store.restore(node)
    node.step(None if cleared else Time.from_ns(6_000))
    previously_saved = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink" if cleared else "open", disk_full)
        store.checkpoint(node, now=True)
    assert "No space left on device" in caplog.text
    assert path.read_bytes() == previously_saved
    store.checkpoint(node)
    assert not path.exists() if cleared else path.read_bytes() != previously_saved


def test_an_activation_record_that_cannot_be_deleted_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Path, "unlink", disk_full)
    ActivityRecord(tmp_path / "slam.active").remove()
    assert "is not removed" in caplog.text


@pytest.mark.parametrize(
    "damage", [lambda d: d[:-1], lambda d: d[:-1] + b"\xff", lambda d: b"", lambda d: b"\x00" * 99]
)
def test_a_corrupt_file_is_renamed_and_reported(path: Path, damage: Any) -> None:
    node_with_saved_state(path)
    path.write_bytes(damage(path.read_bytes()))
    node = LastTimeDfpc()
    with pytest.raises(CodecError, match="SHA-256"):
        StateStore(path).restore(node)
    assert node.last_time is None
    assert not path.exists()
    assert path.with_suffix(".broken").exists()


def test_a_corrupt_file_that_cannot_be_renamed_is_not_partly_restored(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    node_with_saved_state(path)
    monkeypatch.setattr(Path, "replace", disk_full)

    class PartlyRestored(LastTimeDfpc):
        def resume(self, state: Any) -> None:
            self.last_time = state
            raise InputError("a field is missing")

    node = PartlyRestored()
    with pytest.raises(OSError, match="No space left"):
        StateStore(path).restore(node)
    assert node.last_time is None


def test_a_state_refused_by_the_dfpc_is_renamed(path: Path) -> None:
    node_with_saved_state(path)

    class Refusing(LastTimeDfpc):
        def resume(self, state: Any) -> None:
            raise InputError("of another DFPC")

    with pytest.raises(CdffError, match="of another DFPC"):
        StateStore(path).restore(Refusing())
    assert path.with_suffix(".broken").exists()


def test_an_interrupted_save_keeps_the_previous_state(path: Path) -> None:
    node_with_saved_state(path, ns=7_000)
    path.with_name(f"{path.name}.part").write_bytes(b"half of")
    node = LastTimeDfpc()
    StateStore(path).restore(node)
    assert node.last_time is not None
    assert node.last_time.ns == 7_000


def test_the_file_is_in_the_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CDFF_DATA_DIR", str(tmp_path))
    assert state_file("mana", "lidar_slam") == tmp_path / "dfpc" / "mana" / "lidar_slam.state"
