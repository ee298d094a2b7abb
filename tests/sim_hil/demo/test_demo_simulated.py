"""The whole demo on the simulated clock: the story comes true over several seeds, the same way
twice."""

from __future__ import annotations

import contextlib
import io
import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from firmware_py.replay.command import replay
from sim_hil.demo import cli, counterfactual, simulated
from sim_hil.demo.live import Quiet
from sim_hil.demo.observer import StoryObserver
from sim_hil.demo.recording import recorded
from sim_hil.demo.setting import prepare
from sim_hil.demo.story import draw

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
    "not_judged",
    "ok",
    "ok_is",
    "failed_terms",
}


def demo(*options: str) -> dict[str, Any]:
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = cli.main(["--clock", "sim", "--json", *options])
    result: dict[str, Any] = json.loads(said.getvalue())
    assert code == (0 if result["ok"] else 1)
    return result


SEEDS = (1, 2, 3)
WHOLE_S, SHORT_S = 60, 50
"""The shortest stories with a second fault, and with the brain killed."""


@cache
def story(seconds: int, seed: int) -> dict[str, Any]:
    """Of the clearances that could have been held, the short one tries four beside the nominal."""
    with pytest.MonkeyPatch.context() as patch:
        if seconds == SHORT_S:
            patch.setattr(counterfactual, "GRID_STEP_UM", 40.0)
        return demo("--seconds", str(seconds), "--seed", str(seed))


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("seconds", "seed"),
    [(SHORT_S, 1), *(pytest.param(WHOLE_S, seed, marks=pytest.mark.slow) for seed in SEEDS)],
)
def test_the_story_comes_true_and_the_machine_stays_safe(seconds: int, seed: int) -> None:
    result = story(seconds, seed)
    assert set(result) == KEYS
    assert result["not_judged"] == {}, "on bench everything is judged"
    bus = result["bus"]
    assert bus["frames_expected"] == bus["frames_in"] > 1650 * seconds
    assert (bus["frames_lost"], bus["blocks_lost"], result["trips"]) == (0, 0, [])
    assert result["film"]["violation_s"] == 0.0
    (kill,) = result["kills"]
    assert kill["target_safe_ms"] <= 120.0
    assert kill["back_s"] == pytest.approx(3.0, abs=0.1)
    first = result["faults"][0]
    assert (first["name"], first["named"]) == ("unbalance", "unbalance")
    assert result["forecast"]["scored"] > 50 * seconds / WHOLE_S
    # Relative: the reading error of the power channel weighs most where the rig burns least (3 W at
    # 1500 rpm).
    assert result["forecast"]["power_error_pct_p95"] < 30.0
    power = result["power"]
    assert power["actual_W"] < power["counterfactual"]["nominal_fixed_W"]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_power_is_saved_over_all_stories() -> None:
    powers = [story(WHOLE_S, seed)["power"] for seed in SEEDS]
    actual = sum(power["actual_W"] for power in powers)
    fixed = sum(power["counterfactual"]["nominal_fixed_W"] for power in powers)
    assert actual < 0.97 * fixed


def played(seconds: float, recording: Path | None) -> StoryObserver:
    """All that was said and done in a story of seed 4, which may be shorter than a person's."""
    setting = prepare("bench", 4)
    story = draw(seconds, 4, setting.config.machine.operating)
    observer = StoryObserver(simulated.START_NS)
    with recorded(recording, setting.config) as listeners:
        simulated.Player(setting, story, Quiet(), observer, listeners).play()
    return observer


@pytest.mark.parametrize("seconds", [4.0, pytest.param(20.0, marks=pytest.mark.slow)])
def test_same_seed_same_records_and_their_recording_replays(seconds: float, tmp_path: Path) -> None:
    recording = tmp_path / "demo.mcap"
    plain, kept = played(seconds, None), played(seconds, recording)
    assert plain.diagnoses
    assert plain.forecasts
    assert repr(plain) == repr(kept)  # of numbers that are none as well
    report = replay(recording)
    assert report.ok, report
    assert report.decisions.cycles == round(seconds * 1000)
    assert report.brain is not None
