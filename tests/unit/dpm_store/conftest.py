# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the store tests: a clock, and an empty store of each engine."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from itertools import count
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from dpm_store import Store, open_store
from tests.support import postgresql, seaweedfs
from tests.support.postgresql import ENGINES


@pytest.fixture
def clock() -> ManualClock:
    """A clock that is advanced by the test."""
    return ManualClock(1_000_000_000_000)


@pytest.fixture(scope="session")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of an empty store that tests copy, because a migration takes longer than most tests."""
    directory = tmp_path_factory.mktemp("empty")
    open_store(f"sqlite:///{directory}").close()
    return directory


#: Removes all rows.
_CLEAR = """DO $$ BEGIN EXECUTE (
    SELECT 'TRUNCATE ' || string_agg(tablename, ',') FROM pg_tables
    WHERE schemaname = 'public' AND tablename NOT IN ('alembic_version', 'spatial_ref_sys')
); END $$"""


class NewStores:
    """Databases of empty stores.

    Attributes
    ----------
    of : callable
        Returns the URL of an empty store of an engine, whose directory is given.
    """

    def __init__(self, empty: Path) -> None:
        self._empty = empty
        self._numbers = count()
        self._used: list[str] = []
        self._free: list[str] = []
        self._exit_stack = ExitStack()
        self._cluster: postgresql.Cluster | None = None
        self._objects: seaweedfs.ObjectServer | None = None

    def of(self, engine: str, directory: Path) -> str:
        if engine == "sqlite":
            shutil.copytree(self._empty, directory, dirs_exist_ok=True)
            return f"sqlite:///{directory}"
        payloads = self._start_object_server() if engine == "postgresql+s3" else ""
        if self._free:
            name = self._free.pop()
            self.cluster.execute(_CLEAR, name)
        else:
            name = f"store_{next(self._numbers)}"
            self.cluster.execute(f"CREATE DATABASE {name} TEMPLATE empty STRATEGY file_copy")
        self._used.append(name)
        return self.cluster.url(name, directory, payloads)

    def release(self, names: int) -> None:
        """Use the databases again that were created after the first ``names``: a copy takes longest."""
        self._free += self._used[names:]
        del self._used[names:]

    def discard(self) -> None:
        """Use the databases in use never again, because a test has changed their schema."""
        self._used.clear()

    @property
    def used(self) -> int:
        """Number of databases in use."""
        return len(self._used)

    @property
    def cluster(self) -> postgresql.Cluster:
        """A server with the database ``empty``, from which the others are copied."""
        if reason := postgresql.missing():
            pytest.skip(reason)
        if self._cluster is None:
            self._cluster = self._exit_stack.enter_context(postgresql.cluster("fsync=off"))
            self._cluster.execute("CREATE DATABASE empty")
            open_store(self._cluster.url("empty", self._empty.with_name("directory"))).close()
        return self._cluster

    def _start_object_server(self) -> str:
        """Return the URL of new payloads; the server is started the first time."""
        if reason := seaweedfs.missing():
            pytest.skip(reason)
        if self._objects is None:
            self._objects = self._exit_stack.enter_context(seaweedfs.object_server())
        return f"s3://{seaweedfs.BUCKET}/{next(self._numbers)}"

    def close(self) -> None:
        self._exit_stack.close()


@pytest.fixture(scope="session")
def new_stores(empty: Path) -> Iterator[NewStores]:
    """Empty stores of each engine."""
    stores = NewStores(empty)
    yield stores
    stores.close()


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run the tests that use ``engine`` on each engine, or on those in ``ENGINES`` of their module."""
    is_chosen = any(mark.args[0] == "engine" for mark in metafunc.definition.iter_markers("parametrize"))
    if "engine" in metafunc.fixturenames and not is_chosen:
        metafunc.parametrize("engine", getattr(metafunc.module, "ENGINES", ENGINES), scope="session")


@pytest.fixture
def new_store(new_stores: NewStores, engine: str) -> Iterator[Callable[[Path], str]]:
    """Function that returns the URL of an empty store, whose directory is given."""
    used = new_stores.used
    yield partial(new_stores.of, engine)
    new_stores.release(used)


@pytest.fixture
def store(tmp_path: Path, clock: ManualClock, new_store: Callable[[Path], str]) -> Iterator[Store]:
    """An empty store."""
    with open_store(new_store(tmp_path / "data"), clock) as store:
        yield store
