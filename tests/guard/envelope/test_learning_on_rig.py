"""While the machine moves the guard learns nothing that is not so: oil and load stay within what it
believes."""

import pytest

from .learning_runs import KINDS, learnt

EXCLUDED_BEFORE = [
    ("opening", 9),
    ("opening", 17),
    ("closing", 1),
    ("closing", 20),
    ("closing", 22),
    ("closing", 25),
]
"""Builds whose oil was learnt wrongly while only the speed had to be steady: 2 of 30 that open, 5
of 30 that close."""


@pytest.mark.parametrize(
    ("kind", "seed"), [*EXCLUDED_BEFORE, ("speed", 2), ("load", 3), ("hold", 4)]
)
def test_what_is_learnt_never_excludes_the_truth(kind: str, seed: int) -> None:
    found = learnt(seed, kind)
    assert found.oil_excluded == 0
    assert found.load_excluded == 0


def test_a_machine_that_holds_still_is_learnt() -> None:
    assert all(learnt(seed, "hold").looks for seed in (1, 4, 7))


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_in_a_thousand_runs_of_each_kind_at_most_one_excludes_the_truth(kind: str) -> None:
    found = [learnt(seed, kind) for seed in range(1, 1001)]
    assert sum(run.oil_excluded > 0 for run in found) <= 1
    assert sum(run.load_excluded > 0 for run in found) <= 1
