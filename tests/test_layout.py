"""A class name means one thing, a folder holds what belongs together, a line fits."""

from __future__ import annotations

from tests.layout import classes, long_lines, root_modules

GUARD_MOST, SIMULATOR_MOST = 8, 16


def test_no_class_name_stands_twice() -> None:
    found = classes()
    assert len(found) > 500
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


def test_no_line_is_longer_than_the_formatter_makes_them() -> None:
    assert long_lines() == []


def test_roots_hold_few_modules() -> None:
    assert "core.py" in root_modules("firmware_py/guard")
    assert len(root_modules("firmware_py/guard")) <= GUARD_MOST
    assert len(root_modules("sim_hil")) <= SIMULATOR_MOST
