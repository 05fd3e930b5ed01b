# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md"))]
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_COMMAND = re.compile(r"^(?:\.venv/bin/)?cdff ([a-z]+)", re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_link_inside_the_tree_has_a_target(page: Path) -> None:
    for link in _LINK.findall(page.read_text(encoding="utf-8")):
        if not link.startswith(("http://", "https://", "#", "mailto:")):
            assert (page.parent / link.split("#")[0]).exists(), link


def test_every_page_is_linked_from_the_index() -> None:
    docs = ROOT / "docs"
    linked_pages: set[Path] = set()
    queue = [docs / "index.md"]
    while queue:
        page = queue.pop()
        if page in linked_pages or page.suffix != ".md" or not page.is_file():
            continue
        linked_pages.add(page)
        links = _LINK.findall(page.read_text(encoding="utf-8"))
        queue += [(page.parent / link.split("#")[0]).resolve() for link in links if "://" not in link]
    assert sorted(p.relative_to(docs).as_posix() for p in docs.rglob("*.md") if p not in linked_pages) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_command_on_a_page_exists(page: Path) -> None:
    from cdff_common import cli

    nouns = {entry.name for entry in cli.entry_points(group=cli.GROUP)}
    for noun in _COMMAND.findall(page.read_text(encoding="utf-8")):
        assert noun in nouns, f"cdff {noun}"


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "dfpcs").glob("*.md")), ids=lambda p: p.stem)
def test_the_page_of_a_compound_has_at_most_600_words(page: Path) -> None:
    """Tables count; commands in code blocks, references and tokens without a letter or digit do not."""
    text = page.read_text(encoding="utf-8").split("\n## References\n")[0]
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    words = [word for word in text.split() if re.search(r"\w", word)]
    assert len(words) <= 600, f"{len(words)} words; move derivations and history to docs/evaluation"
