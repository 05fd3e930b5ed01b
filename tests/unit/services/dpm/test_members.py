# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cdff_common.bus.identity import Identity
from dpm_store.history.events import Actor
from services.dpm.http.middleware.members import Members

SCOPE: dict[str, Any] = {"state": {"certificate_common_name": "alice.1"}}
ALICE = Actor("alice", "operator", "http")


def test_a_certificate_is_accepted_until_it_leaves_the_list(tmp_path: Path) -> None:
    path = tmp_path / "members.json"
    path.write_text(json.dumps({"alice.1": ["alice", "operator"], "bob.1": ["bob", "king"]}))
    members = Members(Identity(tmp_path))
    assert members.actor(SCOPE) == ALICE
    assert members.actor({"state": {"certificate_common_name": "bob.1"}}) is None  # no such role
    assert members.actor({"state": {}}) is None
    replacement = tmp_path / "new"
    replacement.write_text("{}")
    replacement.replace(path)
    assert members.actor(SCOPE) is None


def test_without_a_readable_list_no_certificate_is_accepted(tmp_path: Path) -> None:
    assert Members(Identity(tmp_path)).actor(SCOPE) is None
    (tmp_path / "members.json").write_text("[")
    assert Members(Identity(tmp_path)).actor(SCOPE) is None
