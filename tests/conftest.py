"""A test that is skipped for a reason outside ``allowed_skips.txt`` fails the run.

Tests that run side by side compute with one thread each: with more, each waits for the other's.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from models.workers import THREADS

if "PYTEST_XDIST_WORKER" in os.environ:  # before numpy is imported
    for name in THREADS:
        os.environ.setdefault(name, "1")

ALLOWED = {
    line.strip()
    for line in (Path(__file__).parent / "allowed_skips.txt").read_text().splitlines()
    if line.strip() and not line.startswith("#")
}
_unexpected: list[str] = []


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.skipped and not hasattr(report, "wasxfail") and isinstance(report.longrepr, tuple):
        reason = report.longrepr[2].removeprefix("Skipped: ")
        if reason not in ALLOWED:
            _unexpected.append(f"{report.nodeid}: {reason}")


def pytest_sessionfinish(session: pytest.Session) -> None:
    if _unexpected and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    for line in _unexpected:
        terminalreporter.write_line(
            f"skipped for a reason that is not in allowed_skips.txt: {line}", red=True
        )
