"""``docs/machine_keys.md`` says who follows which key of ``machine.toml``; each moves
something."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.machine import key_changes, key_matrix, stage_outputs
from tests.machine.key_changes import keys
from tests.machine.key_matrix import STAGES

PAGE = Path(__file__).parents[2] / "docs" / "machine_keys.md"
AGAIN = "python -m tests.machine.key_matrix > docs/machine_keys.md, and say in the commit why"
EACH_QUICK = 9
"""Of the keys, every so many is tried in the default tests."""


def told() -> dict[str, list[str]]:
    """The stages that follow each key, as the page has them."""
    rows = [
        line.split("|")[1:-1] for line in PAGE.read_text().splitlines() if line.startswith("| `")
    ]
    return {
        key.strip(" `"): [stage for stage, mark in zip(STAGES, marks, strict=True) if mark.strip()]
        for key, *marks in rows
    }


def test_every_key_is_on_the_page_and_each_is_followed() -> None:
    assert list(told()) == keys(), AGAIN
    assert [key for key, stages in told().items() if not stages] == []
    assert set(key_matrix.NOT_FOLLOWED) <= set(keys())


@pytest.mark.parametrize("key", keys()[::EACH_QUICK])
def test_a_key_is_followed_by_the_stages_of_the_page(key: str, kept: dict[str, object]) -> None:
    assert key_matrix.followers(key, kept) == told()[key], AGAIN  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def kept() -> dict[str, object]:
    """Machines before a key is changed, for many keys."""
    return {}


@pytest.mark.slow
def test_the_page_is_that_of_the_code() -> None:
    assert key_matrix.page(key_matrix.matrix()) == PAGE.read_text(), AGAIN


def test_a_stage_that_has_its_own_figure_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """What this test is for: a constant in a stage does not follow the key."""
    key = "contact.circuit_V"
    config = key_changes.base(key)
    before = stage_outputs.of_device(config)["diagnosis"]
    changed = key_changes.changed(config, key)
    same = config.machine.contact
    assert key_matrix.fingerprint(stage_outputs.of_device(changed)["diagnosis"]) != (
        key_matrix.fingerprint(before)
    )
    monkeypatch.setattr("firmware_py.acquire.film_check.circuit_of", lambda machine: same)
    features = [stage_outputs.of_device(c)["diagnosis"][-3] for c in (config, changed)]
    assert key_matrix.fingerprint(features[0]) == key_matrix.fingerprint(features[1])
