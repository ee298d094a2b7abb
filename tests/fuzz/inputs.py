"""Any bytes on any input: no exception leaves the code that reads them, and nothing takes long.

Each payload has a seed of its own, so that a failure is one command: ``python -m tests.fuzz NAME``
with ``--seed``.
"""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path
from typing import Final

from .mutate import mutated
from .outcome import Outcome
from .targets import INPUTS

LIMIT_S: Final = 2.0
SEEDS: Final = 1_000_000_000
"""Payloads of one ``--seed``."""


def run(name: str, seed: int, n: int, folder: Path, first: int = 0) -> Outcome:
    """Feed the payloads ``first`` to ``first + n`` of ``seed`` to the input ``name``."""
    outcome = Outcome()
    for number in range(first, first + n):
        wrong = wrong_with(name, mutated(_built(name)[1], seed * SEEDS + number))
        outcome.add(f"{name}, seed {seed}, case {number}", not wrong, wrong)
    return outcome


def wrong_with(name: str, data: bytes) -> list[str]:
    """What is wrong with how the input ``name`` took ``data``; empty when nothing is."""
    start = time.perf_counter()
    wrong = []
    try:
        _built(name)[0](data)
    except Exception as error:  # noqa: BLE001 -- whatever it is, it is what is looked for
        wrong.append(f"{type(error).__name__}: {error}; {data[:80]!r}")
    took_s = time.perf_counter() - start
    if took_s > LIMIT_S:
        wrong.append(f"took {took_s:.1f} s; {data[:80]!r}")
    return wrong


@cache
def _built(name: str):  # type: ignore[no-untyped-def]
    return next(each for each in INPUTS if each.name == name).build()
