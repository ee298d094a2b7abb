"""The command says what it can do for which machine, and on which device."""

from __future__ import annotations

import importlib.util
import shutil
import tomllib
from pathlib import Path

import msgspec
import pytest

from firmware_py.config import SHIPPED, load
from models import ARTIFACTS
from models.builder import NEEDED, BuildError, main, stages
from models.builder.real import real_figures
from models.builder.rig_build import RigBuild, StageResult, alone
from models.builder.run import summary
from models.runs import TrainingRun

from ..rigs import bench_copy


def test_a_device_without_the_extras_says_what_it_can_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "torch" else there(name)
    )
    said = r"torch not installed: pip install 'orbitd\[train\]'"
    with pytest.raises(BuildError, match=said) as e:
        main([str(tmp_path)])
    assert "commission start" in str(e.value)
    assert "copy the folder" in str(e.value)


def test_needed_packages_have_extras_of_the_project() -> None:
    root = Path(__file__).resolve().parents[3]
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    assert set(NEEDED.values()) <= set(extras["optional-dependencies"])


@pytest.mark.parametrize(
    ("named", "said"),
    [("bench", "orbitd rig new my_rig --from bench"), ("nowhere", "orbitd rig new nowhere")],
)
def test_what_is_no_folder_of_ones_own_is_refused(named: str, said: str) -> None:
    with pytest.raises(BuildError, match=said) as e:
        main([named])
    assert "your folder" not in str(e.value)


def test_a_file_of_a_rig_folder_is_told_its_folder(tmp_path: Path) -> None:
    folder = bench_copy(tmp_path / "mill")
    with pytest.raises(BuildError, match=f"a file; give its folder: `orbitd build {folder}`"):
        main([str(folder / "machine.toml")])


def test_a_folder_named_as_a_shipped_rig_is_told_how_to_be_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench_copy(tmp_path / "bench")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BuildError, match=r"\(\./bench is your folder\)"):
        main(["bench"])


def test_missing_recordings_are_named_before_anything_is_built(tmp_path: Path) -> None:
    shutil.copytree(SHIPPED / "kit", tmp_path / "kit")  # nothing is built for it
    with pytest.raises(BuildError, match="--data nosuch: no such folder"):
        main([str(tmp_path / "kit"), "--data", "nosuch"])


def test_ctrl_c_says_that_the_same_command_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> StageResult:
        raise KeyboardInterrupt

    folder = bench_copy(tmp_path / "mill")
    monkeypatch.setitem(stages.STAGES, "surrogate", interrupted)
    assert main([str(folder), "--size", "trial"]) == 130
    said = capsys.readouterr().err
    assert f"interrupted; the same command goes on where it was ({folder}/build)" in said


def test_a_machine_that_is_only_watched_is_told_what_stands_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(SHIPPED / "kit", tmp_path / "kit")
    assert main([str(tmp_path / "kit")]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "orbitd commission start" in said
    assert "surrogate, predictor, classifier, sensors, policies, sealed: not simulated: kit" in said
    assert sorted(p.name for p in (tmp_path / "kit").iterdir()) == ["device.toml", "machine.toml"]


def build_of(folder: Path, **sampling: int) -> RigBuild:
    config, _ = load(folder)
    if sampling:
        config = config.replaced(sampling=msgspec.structs.replace(config.sampling, **sampling))
    return RigBuild.of(folder, config, "trial", 0, 1)


def test_what_the_machine_cannot_have_is_left_out_by_name(tmp_path: Path) -> None:
    folder = bench_copy(tmp_path / "mill")
    assert build_of(folder).left_out == {}
    odd = build_of(folder, rate_hz=12000).left_out
    assert set(odd) == {"classifier", "sensors"}
    assert "multiples of 5000 Hz" in odd["classifier"]
    (folder / "simulation.toml").unlink()
    assert build_of(folder).rig is None


def test_a_machine_beyond_the_proven_laws_gets_a_classifier_alone(tmp_path: Path) -> None:
    changes = {
        "length_m = 0.02": "length_m = 0.06",
        "pump_flow_max_m3_s = 0.00025": "pump_flow_max_m3_s = 0.01",
    }
    long = {"machine.toml": changes}
    left_out = build_of(bench_copy(tmp_path / "long", long)).left_out
    assert set(left_out) == {"surrogate", "predictor", "policies"}
    assert left_out["policies"].startswith("monitor only: ")


def test_an_edited_machine_begins_anew(tmp_path: Path) -> None:
    folder = bench_copy(tmp_path / "mill")
    before = build_of(folder).work
    assert build_of(folder).work == before
    text = (folder / "machine.toml").read_text()
    (folder / "machine.toml").write_text(text.replace("load_max_N = 300.0", "load_max_N = 200.0"))
    assert build_of(folder).work != before


def test_a_stage_is_done_once(tmp_path: Path) -> None:
    build, calls = build_of(bench_copy(tmp_path / "mill")), []

    def do() -> StageResult:
        calls.append(1)
        return StageResult({"a": 1.0}, {"x.onnx": "x/x.onnx"})

    first, kept = build.kept("stage", do)
    again, kept_again = build.kept("stage", do)
    assert (len(calls), kept, kept_again) == (1, False, True)
    assert (again.report, again.files) == (first.report, first.files)


class Done:
    """A trainer whose training has nothing left to do."""

    @staticmethod
    def train(run: TrainingRun, settings: object) -> dict[str, object]:
        return {"made_in": run.kept("part", lambda: str(run.folder))}


@pytest.fixture
def unfinished(tmp_path: Path) -> RigBuild:
    """A build whose classifier has begun."""
    build = build_of(bench_copy(tmp_path / "mill"))
    build.train("classifier", Done, stages._classifier(build))
    return build


def test_a_half_done_build_travels(unfinished: RigBuild, tmp_path: Path) -> None:
    made = unfinished.train("classifier", Done, stages._classifier(unfinished))
    moved = tmp_path / "other place" / "mill2"
    shutil.copytree(unfinished.folder, moved)
    there = build_of(moved)
    assert there.work.name == unfinished.work.name
    assert there.work.is_dir()
    assert there.train("classifier", Done, stages._classifier(there)) == made


@pytest.mark.parametrize("content", ['{"model": "classifier"}', '{"mod'])
def test_settings_that_do_not_belong_are_told_as_a_build_does(
    unfinished: RigBuild, content: str
) -> None:
    there = unfinished.work / "classifier-seed0"
    (there / "config.json").write_text(content)
    with pytest.raises(BuildError, match=rf"config\.json: .*delete {there}") as e:
        unfinished.train("classifier", Done, stages._classifier(unfinished))
    assert "--resume" not in str(e.value)


def test_a_damaged_checkpoint_is_told_as_a_build_does(unfinished: RigBuild) -> None:
    (kept,) = unfinished.work.glob("classifier-seed0/checkpoints/*")
    kept.write_bytes(b"half")
    with pytest.raises(BuildError, match=r"part\.ckpt.*delete.*the same command goes on") as e:
        unfinished.train("classifier", Done, stages._classifier(unfinished))
    assert "--resume" not in str(e.value)


def test_a_figure_that_is_none_comes_back_as_none(tmp_path: Path) -> None:
    build = build_of(bench_copy(tmp_path / "mill"))
    report = {"a": float("nan"), "b": [1.5, float("inf")], "c": {"d": 2}}
    build.kept("stage", lambda: StageResult(report))
    again, _ = build.kept("stage", lambda: StageResult())
    assert again.report == {"a": None, "b": [1.5, None], "c": {"d": 2}}


def test_two_builds_of_one_folder_do_not_meet(tmp_path: Path) -> None:
    with alone(tmp_path), pytest.raises(BuildError, match="another build"), alone(tmp_path):
        pass
    with alone(tmp_path):
        assert (tmp_path / "build").is_dir()


def test_a_trial_does_not_take_the_place_of_a_set_that_passed(tmp_path: Path) -> None:
    folder = tmp_path / "bench"
    shutil.copytree(SHIPPED / "bench", folder)
    shutil.copytree(ARTIFACTS, folder / "models")
    with pytest.raises(BuildError, match="passed its sealed test and fits the machine"):
        main([str(folder), "--size", "trial"])
    assert not (folder / "build").exists()


def test_recordings_that_are_asked_for_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="no such folder"):
        real_figures(tmp_path / "none", True, 0)
    assert real_figures(tmp_path / "none", False, 0)["of"] == "other people's machines"


def test_a_trial_says_that_it_is_one(tmp_path: Path) -> None:
    build = build_of(bench_copy(tmp_path / "mill"))
    results = {
        "classifier": StageResult({}, {"classifier.onnx": "c"}),
        "sealed": StageResult({"left_out": "a trial"}),
    }
    lines = summary(build, results, tmp_path / "models")
    assert "classifier: PROVISIONAL: no sealed test" in lines[1]
    assert "TRIAL" in lines[-1]
