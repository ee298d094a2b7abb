"""The page about one's own recordings: its commands run in its order, its tables are understood."""

import re
import shlex
import tomllib
from pathlib import Path

import msgspec
import pytest

from firmware_py.config import Config
from models import evaluate, train
from models.diagnosis import dataset_command
from models.readers import READERS
from models.readers.channel_map import read_map

from .test_measured import turning
from .test_measured_file import stored

PAGE = Path(__file__).parents[2] / "docs" / "recordings.md"
MAINS = {"dataset": dataset_command.main, "train": train.main, "evaluate": evaluate.main}
TEXT = PAGE.read_text(encoding="utf-8")


def test_every_suffix_stands_on_the_page():
    assert set(re.findall(r"`(\.\w+)`", TEXT)) == set(READERS)


def test_its_channel_map_and_its_settings_are_understood(tmp_path):
    plan, device = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    (tmp_path / "channels.toml").write_text(plan)
    assert read_map(tmp_path / "channels.toml").channel[0].scale == 10.0
    settings = tomllib.loads(device)["models"]
    known = next(f.type for f in msgspec.structs.fields(Config) if f.name == "models")
    assert set(settings) <= set(known.__struct_fields__)


@pytest.mark.slow
def test_its_commands_run_in_its_order(tmp_path, monkeypatch, capsys):
    stored(tmp_path / "my_rig", turning(3.0, 3))
    stored(tmp_path / "other_rig", turning(3.0, 5)[6:])
    monkeypatch.chdir(tmp_path)
    lines = [
        shlex.split(line, comments=True) for line in TEXT.splitlines() if line[:11] == "    orbitd "
    ]
    done = []
    for _, command, *arguments in lines:
        if command not in MAINS or "build" in arguments:
            continue
        smoke = ["--smoke", "--out", "runs"] if command == "train" else []
        assert MAINS[command]([*arguments, *smoke]) == 0, capsys.readouterr().err
        done.append(command)
        smoked = tmp_path / "runs" / "measured_model-seed0-smoke"
        if smoked.exists() and not (tmp_path / "runs" / "measured_model-seed0").exists():
            smoked.rename(tmp_path / "runs" / "measured_model-seed0")
    assert done == ["dataset", "dataset", "train", "evaluate", "evaluate", "evaluate"]
