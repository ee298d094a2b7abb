"""The whole demo on the simulated clock: the story comes true over several seeds, the same way
twice."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

KEYS = {
    "duration_s",
    "seed",
    "bus",
    "host",
    "rig",
    "loop",
    "latency_ms",
    "faults",
    "forecast",
    "power",
    "film",
    "kills",
    "trips",
    "ok",
    "ok_is",
    "failed_terms",
}


def demo(*options: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "firmware_py", "demo", "--clock", "sim", "--json", *options],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.stdout, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    assert done.returncode == (0 if result["ok"] else 1)
    return result


SEEDS = (1, 2, 3)


@pytest.fixture(scope="module")
def stories() -> dict[int, dict[str, Any]]:
    """A minute of story for each seed, side by side: the simulated clock does not see the load."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        told = pool.map(lambda seed: demo("--seconds", "60", "--seed", str(seed)), SEEDS)
        return dict(zip(SEEDS, told, strict=True))


@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_lost_and_the_machine_stays_safe(
    stories: dict[int, dict[str, Any]], seed: int
) -> None:
    result = stories[seed]
    assert set(result) == KEYS
    bus = result["bus"]
    assert bus["frames_expected"] == bus["frames_in"] > 99_000
    assert (bus["frames_lost"], bus["blocks_lost"], result["trips"]) == (0, 0, [])
    assert result["film"]["violation_s"] == 0.0
    (kill,) = result["kills"]
    assert kill["target_safe_ms"] <= 120.0
    assert kill["back_s"] == pytest.approx(3.0, abs=0.1)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", SEEDS)
def test_the_unbalance_is_named_and_power_is_foreseen(
    stories: dict[int, dict[str, Any]], seed: int
) -> None:
    result = stories[seed]
    first = result["faults"][0]
    assert (first["name"], first["named"]) == ("unbalance", "unbalance")
    assert result["forecast"]["scored"] > 50
    # Relative: the reading error of the power channel weighs most where the rig burns least (3 W at
    # 1500 rpm).
    assert result["forecast"]["power_error_pct_p95"] < 30.0


@pytest.mark.timeout(600)
def test_power_is_saved_over_all_stories(stories: dict[int, dict[str, Any]]) -> None:
    actual = sum(result["power"]["actual_W"] for result in stories.values())
    fixed = sum(result["power"]["counterfactual"]["nominal_fixed_W"] for result in stories.values())
    assert actual < 0.97 * fixed


@pytest.mark.timeout(300)
def test_same_seed_same_result_and_its_recording_replays(tmp_path: Path) -> None:
    recording = tmp_path / "demo.mcap"
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        both = ([], ["--record", str(recording)])
        plain, recorded = pool.map(lambda more: demo("--seconds", "24", "--seed", "4", *more), both)
    assert plain == recorded
    replay = subprocess.run(
        [sys.executable, "-m", "firmware_py", "replay", str(recording), "--json"],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert replay.returncode == 0, replay.stdout + replay.stderr
    assert json.loads(replay.stdout)
