"""The short form of the fuzz of configurations."""

from __future__ import annotations

from pathlib import Path

import pytest

from . import config_cases, configurations


def test_what_is_called_good_is_built_and_the_rest_is_refused_by_name(tmp_path: Path) -> None:
    outcome = configurations.run(11, 120, tmp_path)
    assert outcome.failures == []
    assert 10 < outcome.good < 110


def test_what_is_called_good_runs_a_second(tmp_path: Path) -> None:
    """Machines far from the shipped ones, each driven by its guard and brain."""
    ran = 0
    for i in range(60):
        good, wrong = configurations.judge(config_cases.varied(5, i), tmp_path, drive=ran < 12)
        assert not wrong, f"case {i}: {wrong}"
        ran += good
    assert ran >= 12


@pytest.mark.timeout(120)
def test_real_processes_start_or_refuse(tmp_path: Path) -> None:
    outcome = configurations.run_started(3, 4, tmp_path)
    assert outcome.failures == []
