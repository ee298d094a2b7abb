"""What the pages name exists: files, targets of make, records."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = (
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md"))),
)
RECIPES = "docs/how_to_add.md"
WALK = "docs/life_of_a_sample.md"
ASKED_RECIPES = (
    "slow reading", "fast channel", "actuator", "fault class", "bearing type", "bus",
    "key expression", "policy",
)  # fmt: skip
FOLDERS = "firmware_py|sim_hil|models|tests|deploy|docs"
NAMED = re.compile(rf"`((?:{FOLDERS})/[\w./-]*[\w/])`")
LINKED = re.compile(r"\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)")
TARGET = re.compile(r"`make ([a-z-]+)")
RECORD = re.compile(r"`([A-Z][a-z]+[A-Za-z]*)`")


@cache
def text(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


@cache
def classes() -> frozenset[str]:
    """Names of all classes of the device."""
    return frozenset(
        node.name
        for path in (ROOT / "firmware_py").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_a_page_names_exists(page: str) -> None:
    linked = [str((ROOT / page).parent / link) for link in LINKED.findall(text(page))]
    named = [str(ROOT / name) for name in NAMED.findall(text(page))]
    assert [path for path in linked + named if not Path(path).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_target_that_a_page_names_exists(page: str) -> None:
    targets = re.findall(r"^([a-z-]+):", text("Makefile"), re.MULTILINE)
    assert set(TARGET.findall(text(page))) <= set(targets)


def test_each_recipe_names_files_and_tests() -> None:
    parts = re.split(r"^## ", text(RECIPES), flags=re.MULTILINE)[1:]
    heads = [part.partition("\n")[0] for part in parts]
    for wanted, head, part in zip(ASKED_RECIPES, heads, parts, strict=True):
        assert wanted in head
        named = NAMED.findall(part)
        assert len(named) > 3
        assert any(name.startswith("tests/") for name in named), head


def test_the_walk_names_records_that_exist_in_the_order_of_the_sample() -> None:
    walk = text(WALK)
    assert set(RECORD.findall(walk)) - {"NaN"} <= classes()
    order = ["RawFrame", "SampleFrame", "Block", "Window", "Diagnosis", "Advice", "Target"]
    places = [walk.index(f"`{name}`") for name in order]
    assert places == sorted(places)
