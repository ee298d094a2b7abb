"""The verdict's rules: which of them goes first, rows alone and together, how long a word
stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firmware_py.brain.verdict import (
    CLASSES,
    DOUBT,
    NO_CHANNEL,
    NONE,
    SENSOR_FAULT,
    UNKNOWN,
    WHIRL,
    WINDOWS,
    Found,
    VerdictLimits,
    confirmed,
    held_since_ns,
    verdicts,
)

UNBALANCE = list(CLASSES).index("unbalance")
LIMITS = VerdictLimits(1.0, np.full(5, 100.0))
SECOND = 1_000_000_000


def found(n: int = 1, **changed: object) -> Found:
    """Rows that name unbalance surely; what is changed is changed in all of them."""
    yes = np.full(n, True)
    rows = Found(
        np.tile([-9.0, -9.0, -9.0, 9.0], (n, 1)),
        np.zeros(n),
        np.full(n, np.nan),
        ~yes,
        np.full(n, WINDOWS),
        bad=~yes,
        turning=yes,
        answered=yes,
    )
    columns = {
        name: np.full(n, value) if name not in ("log_odds", "absent") else value
        for name, value in changed.items()
    }
    return replace(rows, **columns)  # type: ignore[arg-type]


def test_the_first_rule_that_applies_decides() -> None:
    """Each row breaks one rule more than the one before."""
    changed: dict[str, object] = {}
    for name, value, word in (
        ("windows", WINDOWS - 1, DOUBT),
        ("novelty", 1.1, UNKNOWN),
        ("answered", False, NONE),
        ("absent", True, NO_CHANNEL),
        ("whirl", True, WHIRL),
        ("turning", False, NONE),
        ("bad", True, SENSOR_FAULT),
    ):
        changed[name] = value
        assert verdicts(found(**changed), LIMITS) == [word], name
    assert verdicts(found(), LIMITS) == [UNBALANCE]


@pytest.mark.parametrize(
    ("own", "novelty", "log_odds", "word"),
    [
        (0.9, 0.0, 9.0, UNBALANCE),
        (1.1, 0.0, 9.0, UNBALANCE),  # far from its own normal, and like what was taught
        (1.1, 1.1, 9.0, UNKNOWN),
        (0.9, 1.1, 9.0, UNBALANCE),  # unlike the fleet, and as this machine always was
        (0.9, 1.1, -9.0, 0),
        (1.1, 0.0, -9.0, UNKNOWN),
        (1.1, 0.0, 0.1, UNKNOWN),  # no class is sure enough to speak against it
    ],
)
def test_a_commissioned_machine_is_held_against_itself(
    own: float, novelty: float, log_odds: float, word: int
) -> None:
    odds = np.array([[-9.0, -9.0, -9.0, log_odds]])
    assert verdicts(found(own=own, novelty=novelty, log_odds=odds), LIMITS) == [word]


def test_rows_together_are_judged_as_each_alone() -> None:
    rng, n = np.random.default_rng(0), 10_000
    flags = [rng.random(n) < share for share in (0.1, 0.05, 0.9, 0.9)]
    own = np.where(rng.random(n) < 0.5, np.nan, rng.uniform(0.0, 2.0, n))
    rows = Found(
        rng.normal(0.0, 6.0, (n, 4)),
        rng.uniform(0.0, 1.5, n),
        own,
        flags[0],
        rng.integers(8, 11, n),
        bad=flags[1],
        turning=flags[2],
        answered=flags[3],
    )
    together = verdicts(rows, LIMITS)
    alone = [int(verdicts(rows.subset(np.array([i])), LIMITS)[0]) for i in range(n)]
    assert together.tolist() == alone
    assert set(alone) == set(range(UNKNOWN + 6)) - {NO_CHANNEL}


def test_a_word_stands_since_it_was_last_another() -> None:
    words = np.array([4, 4, 0, 4, 4, 4])
    ends = np.array([1, 2, 3, 4, 5, 7]) * SECOND
    assert (held_since_ns(words, ends) // SECOND).tolist() == [1, 1, 3, 4, 4, 4]
    assert confirmed(words, ends).tolist() == [False] * 5 + [True]
