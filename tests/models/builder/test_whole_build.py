"""A whole build: killed and gone on with, spread over workers, or straight through, it gives the
same bytes, and the device takes them."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from firmware_py.brain.store import load_models
from firmware_py.config import load
from firmware_py.config.written import write_rig
from models import workers
from models.builder import main, sizes, stages
from models.builder.sizes import Sizes
from models.control.learners import ActorSettings
from models.diagnosis.classifier import ClassifierSettings
from models.diagnosis.judge import JudgeSettings
from models.diagnosis.rungs import LadderSettings
from models.film.surrogate import SurrogateSettings
from models.learning.ddpg import DdpgSettings
from models.prediction.predictor import PredictorSettings
from models.qualify import Bar, load_bars
from models.workers import SpreadError, spread

from ..rigs import MILL, bench_copy

SMOKE = Sizes(
    surrogate=SurrogateSettings().smoked(),
    predictor=PredictorSettings(episodes=8, judged_episodes=4),
    classifier=ClassifierSettings(
        builds=8,
        raw_builds=0,
        judge=JudgeSettings(
            builds=2,
            unknown_builds=2,
            watched_builds=2,
            held_builds=1,
            onset_builds=2,
            keep_samples=False,
        ),
        ladder=LadderSettings(
            hidden=8,
            own_hidden=2,
            members=2,
            l2=(1e-3,),
            iterations=40,
            paper_hidden=4,
            paper_iterations=5,
            waveforms=False,
        ),
        folds=3,
        keep_samples=False,
    ),
    policies=ActorSettings(
        seeds=1,
        rotors=2,
        episode_s=2.0,
        ddpg=DdpgSettings(steps=60, warm_up=20, batch=16, hidden=(8, 8)),
        dqn_clearances=3,
        lookup_points=(2, 2, 3),
        validation_episodes=1,
        judged_episodes=1,
        judged_seconds=1.0,
        pair=False,
        predictive=False,
        elsewhere=False,
    ),
    sensors=(2, 20),
    sealed=False,
)
RUN = (
    "import sys\n"
    "from models.builder import main, sizes\n"
    "from tests.models.builder.test_whole_build import SMOKE\n"
    "sizes.TRIAL = SMOKE\n"
    "sys.exit(main(sys.argv[1:]))\n"
)
ROOT = Path(__file__).resolve().parents[3]
MODELS = ("classifier.onnx", "actor.onnx", "surrogate.onnx", "predictor.json", "manifest.json")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The rig with the set that an undisturbed build made."""
    folder = bench_copy(tmp_path_factory.mktemp("straight") / "mill", MILL)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sizes, "TRIAL", SMOKE)
        assert main([str(folder), "--size", "trial", "--workers", "1"]) == 0
    return folder


def as_made(rig: Path, elsewhere: Path) -> Path:
    """The same rig without what was built, at another place."""
    shutil.copytree(rig, elsewhere, ignore=shutil.ignore_patterns("build", "models"))
    return elsewhere


def content(rig: Path) -> dict[str, bytes]:
    return {name: (rig / "models" / name).read_bytes() for name in MODELS}


def test_the_device_takes_what_was_built_for_it(straight: Path, tmp_path: Path) -> None:
    models = load_models(load(straight)[0])
    assert not models.refusals
    assert models.classifier is not None
    assert models.actor is not None
    assert set(models.factors.factors) == {"as_built", "zeroed"}
    moved = tmp_path / "moved"
    write_rig({p.name: p.read_text() for p in straight.glob("*.toml")}, moved, straight / "models")
    assert not load_models(load(moved)[0]).refusals


def test_another_machine_refuses_it_with_the_figures_that_differ(
    straight: Path, tmp_path: Path
) -> None:
    other = bench_copy(tmp_path / "other")
    shutil.copytree(straight / "models", other / "models")
    refusals = load_models(load(other)[0]).refusals
    assert set(refusals) == {"classifier", "actor", "predictor"}
    for said in refusals.values():
        assert "operating.load_N 30 .. 200, here 30 .. 300" in said


def test_the_report_is_one_file_that_says_all(straight: Path) -> None:
    page = (straight / "models" / "report.html").read_text()
    for words in (
        "A TRIAL",
        "Diagnosis",
        "What each missing sensor costs",
        "without acc_motor",
        "Forecasts",
        "Policy",
        "For which machine",
        "Real machines",
    ):
        assert words in page
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")
    assert str(straight.parent) not in page


def test_killed_and_gone_on_with_it_gives_the_same_bytes(straight: Path, tmp_path: Path) -> None:
    rig = as_made(straight, tmp_path / "mill")
    command = [sys.executable, "-c", RUN, str(rig), "--size", "trial", "--workers", "1"]
    marks = ("predictor-seed0/checkpoints/*.ckpt", "recordings-judged_cases-*/views-*/00000.npz")
    for mark in marks:
        process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
        give_up = time.monotonic() + 600.0
        while not list((rig / "build").glob(f"*/{mark}")):
            assert process.poll() is None
            assert time.monotonic() < give_up
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not (rig / "models").exists()
    assert subprocess.run(command, cwd=ROOT, stderr=subprocess.DEVNULL, check=False).returncode == 0
    assert content(rig) == content(straight)


def test_the_sealed_test_marks_what_goes_into_the_set(
    straight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = tmp_path / "mill"
    shutil.copytree(straight, rig)
    for kept in rig.glob("build/*/sealed.json"):
        kept.unlink()
    small = {
        kind: msgspec.structs.replace(bars, size=2, bar=[Bar(bars.better.figure, least=-1e9)])
        for kind, bars in load_bars().items()
    }
    monkeypatch.setattr(stages, "load_bars", lambda: small)
    monkeypatch.setattr(sizes, "TRIAL", replace(SMOKE, sealed=True))
    assert main([str(rig), "--size", "trial", "--workers", "1"]) == 0
    page = (rig / "models" / "report.html").read_text()
    assert "classifier: passed (seed 20004, size 2)" in page
    models = load_models(load(rig)[0])
    assert not models.refusals
    assert models.classifier is not None
    assert models.classifier.qualified
    assert "passed its sealed simulation test" in (rig / "models" / "classifier.md").read_text()


@pytest.fixture
def scheduler() -> Iterator[str]:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


def test_spread_over_two_workers_it_gives_the_same_bytes(
    straight: Path, tmp_path: Path, scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sizes, "TRIAL", SMOKE)
    rig = as_made(straight, tmp_path / "mill")
    assert main([str(rig), "--size", "trial", "--spread", scheduler]) == 0
    assert content(rig) == content(straight)


def test_workers_with_other_code_are_refused(
    scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "code_digest", lambda: "another")
    with pytest.raises(SpreadError, match="2 of 2 workers differ"), spread(scheduler):
        pass


def test_an_address_without_a_scheduler_is_refused() -> None:
    pytest.importorskip("distributed", reason="distributed is not installed")
    with pytest.raises(SpreadError, match="no Dask scheduler answers"), spread("tcp://127.0.0.1:9"):
        pass
