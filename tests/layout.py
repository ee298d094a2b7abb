"""Measures of the layout: ``python -m tests.layout`` prints them, a test bars some.

Counted in the packages and ``deploy``, without what is generated; lines in the tests as well.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("firmware_py", "sim_hil", "models", "deploy")
GENERATED = {"mav_dialect.py"}
COLUMNS = 100
LINES = 400
STATEMENTS = 60
BARE = re.compile(r"tuple\[(?!.*\.\.\.\]$)")


@cache
def sources(*folders: str) -> dict[str, str]:
    """Text of every module of ``folders``, by its path."""
    return {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
        for folder in folders
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path.name not in GENERATED
    }


@cache
def tree(path: str) -> ast.Module:
    """Syntax of one module of the packages."""
    return ast.parse(sources(*PACKAGES)[path])


def _nodes() -> Iterator[tuple[str, ast.AST]]:
    for path in sources(*PACKAGES):
        for node in ast.walk(tree(path)):
            yield path, node


def root_modules(package: str) -> list[str]:
    """Modules of ``package`` that stand in no folder of it."""
    found = (ROOT / package).glob("*.py")
    return sorted(path.name for path in found if path.name != "__init__.py")


def classes() -> dict[str, list[str]]:
    """Where each class is defined, by its name."""
    places: dict[str, list[str]] = defaultdict(list)
    for path, node in _nodes():
        if isinstance(node, ast.ClassDef):
            places[node.name].append(f"{path}:{node.lineno}")
    return places


def long_lines() -> list[str]:
    """Places of lines over :data:`COLUMNS`, those of the tests as well."""
    return [
        f"{path}:{number}"
        for path, text in sources(*PACKAGES, "tests").items()
        for number, line in enumerate(text.splitlines(), 1)
        if len(line) > COLUMNS
    ]


def long_files() -> list[str]:
    """Modules of more than :data:`LINES` lines."""
    return [path for path, text in sources(*PACKAGES).items() if text.count("\n") > LINES]


def long_functions() -> list[str]:
    """Functions of more than :data:`STATEMENTS` lines, the docstring included."""
    return [
        f"{path}:{node.name}"
        for path, node in _nodes()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or node.lineno) - node.lineno >= STATEMENTS
    ]


def bare_tuples() -> list[str]:
    """Functions whose result is a tuple of several things without names."""
    return [
        f"{path}:{node.name}"
        for path, node in _nodes()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.returns is not None
        and BARE.match(ast.unparse(node.returns).strip("'\""))
    ]


def module_numbers() -> list[str]:
    """Names at the top of a module that stand for one number."""
    return [
        f"{path}:{node.lineno}"
        for path in sources(*PACKAGES)
        for node in tree(path).body
        if isinstance(node, ast.Assign | ast.AnnAssign) and _is_number(node.value)
    ]


def _is_number(node: ast.expr | None) -> bool:
    try:
        value = ast.literal_eval(node) if node is not None else None
    except ValueError:
        return False
    return isinstance(value, int | float) and not isinstance(value, bool)


if __name__ == "__main__":
    twice = {name: places for name, places in classes().items() if len(places) > 1}
    for words, count in (
        ("modules in the root of firmware_py/guard", len(root_modules("firmware_py/guard"))),
        ("modules in the root of sim_hil", len(root_modules("sim_hil"))),
        ("class names that stand twice", len(twice)),
        (f"lines over {COLUMNS} columns", len(long_lines())),
        (f"modules over {LINES} lines", len(long_files())),
        (f"functions over {STATEMENTS} lines", len(long_functions())),
        ("results that are bare tuples", len(bare_tuples())),
        ("numbers at the top of modules", len(module_numbers())),
    ):
        print(f"{count:6d}  {words}")
