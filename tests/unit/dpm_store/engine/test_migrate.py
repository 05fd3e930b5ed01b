# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The schema of a new store, migrations to later revisions, and refusal of other schemas."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store import Store, open_store
from dpm_store.engine import migrate
from dpm_store.engine.database import Database
from dpm_store.engine.migrate import HEAD, revision_of
from dpm_store.engine.migrations.sqlite import r1_initial
from tests.support.store_products import header, put

#: The files are those of SQLite.
ENGINES = ("sqlite",)

pytestmark = pytest.mark.req("CDFF-SUP-032")
MIGRATIONS = Path(migrate.__file__).parent / "migrations"
NEXT = """
from alembic import op
revision, down_revision = "r2", "r1"
def upgrade():
    op.execute("{statement}")
"""


def set_revision(directory: Path, revision: str) -> None:
    """Set the schema revision of a database."""
    database = Database(directory)
    with database.write() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = ?", (revision,))
    database.close()


@pytest.fixture
def later_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of the migrations of a later version, which has the revision r2."""
    package = tmp_path / "package"
    shutil.copytree(MIGRATIONS, package / "migrations", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(migrate, "files", lambda _name: package)
    monkeypatch.setattr(migrate, "HEAD", "r2")
    return package / "migrations" / "sqlite" / "r2_next.py"


def test_a_new_store_has_the_newest_revision(store: Store) -> None:
    assert revision_of(store._database) == HEAD


def test_the_head_is_the_newest_migration() -> None:
    assert max(path.name.split("_")[0] for path in (MIGRATIONS / "sqlite").glob("r*.py")) == HEAD


def test_the_ddl_of_a_migration_is_literal() -> None:
    source = Path(r1_initial.__file__).read_text()
    imports = [line for line in source.splitlines() if line.startswith(("import ", "from "))]
    standard = ["from __future__ import annotations", "from pathlib import Path"]
    assert imports == [*standard, "from alembic import op"]


def test_a_store_is_migrated_to_a_later_schema_and_keeps_its_products(
    store: Store, later_version: Path
) -> None:
    put(store, header(0), b"payload")
    store.close()
    later_version.write_text(NEXT.format(statement="CREATE TABLE added (name VARCHAR)"))
    with open_store(f"sqlite:///{store.directory}") as migrated:
        assert revision_of(migrated._database) == "r2"
        assert migrated.payload(header(0).id) == b"payload"
        assert migrated.verify() == ()


def test_a_failed_migration_changes_nothing(store: Store, later_version: Path) -> None:
    put(store, header(0), b"payload")
    store.close()
    later_version.write_text(NEXT.format(statement="UPDATE nowhere SET a = 0"))
    with pytest.raises(StorageError, match="nowhere"):
        open_store(f"sqlite:///{store.directory}")
    later_version.write_text(NEXT.format(statement="CREATE TABLE added (name VARCHAR)"))
    with open_store(f"sqlite:///{store.directory}") as migrated:
        assert migrated.payload(header(0).id) == b"payload"


def test_a_store_of_a_newer_version_is_refused(store: Store) -> None:
    store.close()
    set_revision(store.directory, "r9")
    with pytest.raises(ConfigurationError, match=r"schema r9.*newer version"):
        open_store(f"sqlite:///{store.directory}")


def test_a_refused_store_leaves_no_connection_open(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    store.close()
    set_revision(store.directory, "r9")
    closed: list[Database] = []
    close = Database.close

    def counting_close(database: Database) -> None:
        closed.append(database)
        close(database)

    monkeypatch.setattr(Database, "close", counting_close)
    with pytest.raises(ConfigurationError, match="newer version"):
        open_store(f"sqlite:///{store.directory}")
    assert len(closed) == 1


@pytest.mark.parametrize("revision", ["0001", "0005"])
def test_a_store_of_an_unreleased_version_is_refused_with_a_remedy(store: Store, revision: str) -> None:
    store.close()
    set_revision(store.directory, revision)
    with pytest.raises(ConfigurationError, match=rf"schema {revision}.*cdff dpm export"):
        open_store(f"sqlite:///{store.directory}")
