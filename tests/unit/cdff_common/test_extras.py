# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Optional libraries and their extras."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from cdff_common.errors import CdffError
from cdff_common.extras import extra_of, import_extra


@pytest.mark.parametrize(
    ("module", "extra"), [("cv2", "core"), ("sqlalchemy.orm", "dpm"), ("open3d", "simulate"), ("json", None)]
)
def test_the_extra_that_contains_a_library_is_known(module: str, extra: str | None) -> None:
    assert extra_of(module) == extra


def test_a_missing_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> Any:
        raise ModuleNotFoundError(name, name=name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(CdffError, match=r"geopandas is not installed: pip install 'cdff\[analysis\]'"):
        import_extra("geopandas")
