"""The commands: a smoke training of every model, reproducible, and named refusals."""

import json
import subprocess
import sys

import pytest

from models.runs import SettingsError, TrainerSettings, load_settings


class Some(TrainerSettings, frozen=True):
    points: int = 3


def test_settings_from_toml_and_unknown_keys_refused(tmp_path):
    file = tmp_path / "settings.toml"
    file.write_text("points = 5\n")
    assert load_settings(Some, file).points == 5
    file.write_text("pionts = 5\n")
    with pytest.raises(SettingsError, match=r"pionts.*known keys: points"):
        load_settings(Some, file)
    file.write_text("points = ")
    with pytest.raises(SettingsError, match=r"settings.toml"):
        load_settings(Some, file)
    with pytest.raises(SettingsError, match="cannot be read"):
        load_settings(Some, tmp_path / "none.toml")
    assert load_settings(Some, None) == Some()


def test_a_training_without_points_is_refused(tmp_path, capsys):
    from models.train import main

    (tmp_path / "none.toml").write_text("train_points = 0\n")
    assert (
        main(
            ["surrogate", "--config", str(tmp_path / "none.toml"), "--out", str(tmp_path / "runs")]
        )
        == 2
    )
    assert "train_points" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_evaluating_a_missing_file_is_refused(capsys, tmp_path):
    from models.evaluate import main

    assert main(["actor", "--file", str(tmp_path / "none.onnx")]) == 2
    assert "orbitd train actor" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize("kind", ["surrogate", "classifier", "actor"])
def test_smoke_training_makes_a_whole_run_and_repeats_itself(kind, tmp_path):
    """Two processes at once, which on two cores takes the time of one."""
    code = "import sys; from models.train import main; sys.exit(main(sys.argv[1:]))"
    outs = [tmp_path / "first", tmp_path / "second"]
    started = [
        subprocess.Popen(
            [sys.executable, "-c", code, kind, "--smoke", "--seed", "3", "--out", str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for out in outs
    ]
    said = [process.communicate()[0] for process in started]
    weights = []
    for process, text, out in zip(started, said, outs, strict=True):
        assert process.returncode == 0, text[-3000:]
        run = out / f"{kind}-seed3-smoke"
        assert {p.name for p in run.iterdir()} >= {
            "config.json",
            "metrics.csv",
            f"{kind}.onnx",
            f"{kind}.json",
            f"{kind}.md",
        }
        config = json.loads((run / "config.json").read_text())
        assert (config["model"], config["seed"], config["smoke"]) == (kind, 3, True)
        assert f"orbitd train {kind} --seed 3 --smoke" in (run / f"{kind}.md").read_text()
        assert json.loads((run / f"{kind}.json").read_text())["export_parity"] <= 1e-6
        weights.append(initializers(run / f"{kind}.onnx"))
    assert weights[0] == weights[1]


def initializers(path):
    import onnx

    return [tensor.raw_data for tensor in onnx.load(path).graph.initializer]
