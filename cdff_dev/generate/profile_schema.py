# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""JSON Schema of the mission profile, with which editors complete and check ``deploy/profiles/*.yaml``."""

from __future__ import annotations

import json

from cdff_common.interfaces.profile import Profile
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.tree import Tree


def schemas(tree: Tree) -> list[Artefact]:
    """Return the artefact ``deploy/profiles/profile.schema.json``."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"} | Profile.model_json_schema()
    path = tree.root / "deploy" / "profiles" / "profile.schema.json"
    return [Artefact(path, json.dumps(schema, indent=2, ensure_ascii=False) + "\n")]
