# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The schema of a new store, migrations to later revisions, and refusal of other schemas."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import text

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store import Store, open_store
from dpm_store.engine import migrate
from dpm_store.engine.database import Database
from dpm_store.engine.location import parse_url
from dpm_store.engine.migrate import HEAD, revision_of
from tests.support.postgresql import WITH_FILES
from tests.support.store_products import header, put
from tests.unit.dpm_store.conftest import NewStores

ENGINES = WITH_FILES

pytestmark = pytest.mark.req("CDFF-SUP-032")
MIGRATIONS = Path(migrate.__file__).parent / "migrations"
NEXT = """
from alembic import op
revision, down_revision = "r2", "r1"
def upgrade():
    op.execute("{statement}")
"""


def set_revision(url: str, revision: str) -> None:
    """Set the schema revision of a database."""
    location = parse_url(url)
    database = Database(location.directory, dialect=location.dialect, url=location.database)
    with database.write() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = :revision"), {"revision": revision})
    database.close()


@pytest.fixture
def url(new_store: Callable[[Path], str], new_stores: NewStores, tmp_path: Path) -> Iterator[str]:
    """URL of a store with one product."""
    url = new_store(tmp_path / "data")
    with open_store(url) as store:
        put(store, header(0), b"payload")
    yield url
    new_stores.discard()


@pytest.fixture
def later_version(url: str, engine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """File of a migration to the revision r2, which a later version of the engine has."""
    package = tmp_path / "package"
    shutil.copytree(MIGRATIONS, package / "migrations", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(migrate, "files", lambda _name: package)
    monkeypatch.setattr(migrate, "HEAD", "r2")
    return package / "migrations" / engine / "r2_next.py"


def test_a_new_store_has_the_newest_revision(store: Store) -> None:
    assert revision_of(store._database) == HEAD


@pytest.mark.parametrize("engine", ["sqlite", "postgresql"])
def test_the_head_is_the_newest_migration(engine: str) -> None:
    assert max(path.name.split("_")[0] for path in (MIGRATIONS / engine).glob("r*.py")) == HEAD


@pytest.mark.parametrize("engine", ["sqlite", "postgresql"])
def test_the_ddl_of_a_migration_is_literal(engine: str) -> None:
    source = (MIGRATIONS / engine / "r1_initial.py").read_text(encoding="utf-8")
    imports = [line for line in source.splitlines() if line.startswith(("import ", "from "))]
    standard = ["from __future__ import annotations", "from pathlib import Path"]
    assert imports == [*standard, "from alembic import op"]


def test_a_store_is_migrated_to_a_later_schema_and_keeps_its_products(url: str, later_version: Path) -> None:
    later_version.write_text(NEXT.format(statement="CREATE TABLE added (name VARCHAR)"), encoding="utf-8")
    with open_store(url) as migrated:
        assert revision_of(migrated._database) == "r2"
        assert migrated.payload(header(0).id) == b"payload"
        assert migrated.verify() == ()


def test_a_failed_migration_changes_nothing(url: str, later_version: Path) -> None:
    failing = 'CREATE TABLE added (name VARCHAR)")\n    op.execute("UPDATE nowhere SET a = 0'
    later_version.write_text(NEXT.format(statement=failing), encoding="utf-8")
    with pytest.raises(StorageError, match="nowhere"):
        open_store(url)
    later_version.write_text(NEXT.format(statement="CREATE TABLE added (name VARCHAR)"), encoding="utf-8")
    with open_store(url) as migrated:
        assert migrated.payload(header(0).id) == b"payload"


def test_a_store_of_a_newer_version_is_refused(url: str) -> None:
    set_revision(url, "r9")
    with pytest.raises(ConfigurationError, match=r"schema r9.*newer version"):
        open_store(url)


def test_a_refused_store_leaves_no_connection_open(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    set_revision(url, "r9")
    closed: list[Database] = []
    close = Database.close

    def counting_close(database: Database) -> None:
        closed.append(database)
        close(database)

    monkeypatch.setattr(Database, "close", counting_close)
    with pytest.raises(ConfigurationError, match="newer version"):
        open_store(url)
    assert len(closed) == 1


@pytest.mark.parametrize("revision", ["0001", "0005"])
def test_a_store_of_an_unreleased_version_is_refused_with_a_remedy(url: str, revision: str) -> None:
    set_revision(url, revision)
    with pytest.raises(ConfigurationError, match=rf"schema {revision}.*cdff dpm export"):
        open_store(url)
