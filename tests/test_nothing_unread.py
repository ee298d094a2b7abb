"""A constant or a key of the configuration that no code reads is a promise that nothing keeps."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from msgspec import inspect

from firmware_py.config import Config

ROOT = Path(__file__).resolve().parent.parent
CHECKS_ONLY = ("config/checks", "config/verify", "config/convert")
"""Modules that judge a configuration: what only they read changes nothing."""

GENERATED = "firmware_py/wire/mav_dialect.py"
FOR_TESTS = "firmware_py/guard/process/budget.py"
"""A table of budgets, which the tests hold the code against."""

CONSENTS = {"zenoh.insecure_network"}
"""Keys that say yes to what a check would refuse."""


@cache
def trees() -> dict[str, ast.Module]:
    """Every module of the project but the tests, by its path."""
    paths = [
        p
        for folder in ("firmware_py", "sim_hil", "models", "deploy")
        for p in (ROOT / folder).rglob("*.py")
    ]
    return {
        str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in paths
    }


def constants(tree: ast.Module) -> Iterator[str]:
    """Names in capitals that the module itself binds."""
    for node in tree.body:
        single = [node.target] if isinstance(node, ast.AnnAssign) else []
        for target in node.targets if isinstance(node, ast.Assign) else single:
            for name in ast.walk(target):
                if isinstance(name, ast.Name) and name.id.lstrip("_").isupper():
                    yield name.id


def reads(tree: ast.AST) -> Iterator[str]:
    """Names and attributes that are read, and keyword patterns of a match."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
            yield node.attr


@cache
def read_anywhere() -> frozenset[str]:
    """All that any module reads."""
    return frozenset(name for tree in trees().values() for name in reads(tree))


CONSTANTS = [
    (path, name)
    for path, tree in trees().items()
    if path.startswith("firmware_py") and path not in (GENERATED, FOR_TESTS)
    for name in constants(tree)
]


@pytest.mark.parametrize("path", sorted({path for path, _ in CONSTANTS}))
def test_every_constant_is_read(path: str) -> None:
    unread = [name for at, name in CONSTANTS if at == path and name not in read_anywhere()]
    assert unread == [], f"{path}: nothing reads {', '.join(unread)}; use it or delete it"


def keys(kind: inspect.Type, place: str = "") -> Iterator[tuple[str, str]]:
    """Every key of the configuration: its place and its name."""
    if isinstance(kind, inspect.StructType):
        for each in kind.fields:
            here = f"{place}.{each.name}".lstrip(".")
            inner = list(keys(each.type, here))
            yield from inner or [(here, each.name)]
    elif isinstance(kind, inspect.ListType):
        yield from keys(kind.item_type, place)
    elif isinstance(kind, inspect.UnionType):
        for each_type in kind.types:
            yield from keys(each_type, place)


def test_every_key_of_the_configuration_is_read_by_what_acts_on_it() -> None:
    acting = [
        tree
        for path, tree in trees().items()
        if path.startswith(("firmware_py", "sim_hil"))
        and not any(part in path for part in CHECKS_ONLY)
    ]
    read = {
        node.attr
        for tree in acting
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)
    }
    unread = [place for place, name in keys(inspect.type_info(Config)) if name not in read]
    assert set(unread) <= CONSENTS, f"nothing acts on {', '.join(unread)}"


def test_every_budget_is_held_by_a_test() -> None:
    tests = " ".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py"))
    assert [
        name
        for name in constants(trees()[FOR_TESTS])
        if name not in tests and name not in read_anywhere()
    ] == []


def test_an_unread_constant_and_an_unread_key_are_found() -> None:
    tree = ast.parse("LIMIT: Final = 3\nA, B = 1, 2\n_USED = 4\nx = _USED + c.key\n")
    assert list(constants(tree)) == ["LIMIT", "A", "B", "_USED"]
    assert set(reads(tree)) == {"_USED", "c", "key"} | {"Final"}
