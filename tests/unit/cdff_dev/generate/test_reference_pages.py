# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import argparse

import pytest

from cdff_common import cli
from cdff_dev.generate.reference import command_line, endpoints, keys, types


def test_every_key_of_the_contract_is_documented_with_its_parts() -> None:
    page = keys.page()
    for key in (
        "cdff/@v1/{robot}/product/{dfpc}/{port}",
        "cdff/@v1/{scope}/orchestrator/@rpc/{verb}",
        "cdff/@v1/{scope}/dpm/product/{product_id}",
        "cdff/@v1/{scope}/@alive/{service}",
        "cdff/@v1/ground/clock",
    ):
        assert f"`{key}`" in page


@pytest.mark.slow
def test_the_page_of_a_type_has_units_and_sizes_of_the_asn1_files() -> None:
    page = types.pages()["types/LaserScan.md"]
    assert "# LaserScan" in page
    assert "| `ranges` | array of int -2147483648…2147483647, 1…2000 | mm |" in page


def test_the_command_page_shows_arguments_but_no_local_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CDFF_PROFILE", "deploy/profiles/of_this_machine.yaml")
    page = command_line.page()
    assert "## cdff generate" in page
    assert "`--dry-run`" in page
    assert "of_this_machine" not in page


def test_defaults_and_choices_of_a_command_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    def register(nouns: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
        parser = nouns.add_parser("fake", help="does something")
        parser.add_argument("kind", choices=["a", "b"], help="50 %% of it")
        parser.add_argument("--speed", default="max", metavar="X", help="how fast (default: %(default)s)")

    class Entry:
        name, value = "fake", "somewhere:register"

        def load(self) -> object:
            return register

    monkeypatch.setattr(cli, "entry_points", lambda group: [Entry()])
    page = command_line.page()
    assert "| `{a,b}` |  | 50 % of it. |" in page
    assert "| `--speed X` | `max` | How fast (default: max). |" in page


def test_endpoints_are_those_of_the_openapi_documents(monkeypatch: pytest.MonkeyPatch) -> None:
    document = {
        "paths": {
            "/api/v1/products": {
                "get": {
                    "summary": "search",
                    "parameters": [
                        {
                            "name": "limit",
                            "in": "query",
                            "schema": {"anyOf": [{"type": "integer"}, {"type": "null"}]},
                        }
                    ],
                    "responses": {"200": {}, "422": {}},
                }
            }
        }
    }
    monkeypatch.setattr(endpoints, "openapi", lambda: document)
    page = endpoints.page()
    assert "### GET /api/v1/products\n\nSearch. Answers 200, 422." in page
    assert "| `limit` | query | integer |" in page
