"""Bars apart from training: what qualifies, what may replace the shipped model, what is refused
untouched."""

import hashlib
import json

import numpy as np
import pytest
import torch

from models import PHYSICS_VERSION, checkpoint, export
from models.qualify import Bar, Bars, Better, QualifyError, figure, load_bars, metadata, qualify
from models.runs import SettingsError, TrainerSettings, TrainingRun

BARS = Bars(
    seed=7,
    size=3,
    better=Better("error", "least"),
    bar=[Bar("error", most=1.0), Bar("share.right", least=0.9)],
)


def model(path, error, physics=PHYSICS_VERSION):
    """An exported file whose own metrics say how good it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    about = export.Metadata(
        kind="actor",
        version="0",
        inputs=("a",),
        outputs=("b",),
        domain={},
        rigs=(),
        data_hash="",
        metrics={"error": error},
        units=(),
        physics_version=physics,
    )
    module = torch.nn.Linear(1, 1)
    export.export(
        module, torch.zeros(2, 1), path, input_name="a", output_names=("b",), metadata=about
    )
    return path


def evaluate(path, seed, size):
    assert (seed, size) == (7, 3)  # the frozen evaluation, whatever the caller had in mind
    return {"error": json.loads(metadata(path)["metrics"])["error"], "share": {"right": 0.95}}


@pytest.mark.parametrize(("error", "qualified"), [(0.99, True), (1.01, False)])
def test_every_bar_decides_the_status_in_the_file(tmp_path, error, qualified):
    path = model(tmp_path / "actor.onnx", error)
    verdict = qualify("actor", path, evaluate, ship=False, bars=BARS)
    assert verdict["qualified"] is qualified
    assert metadata(path)["status"] == ("qualified" if qualified else "provisional")
    assert [bar["holds"] for bar in verdict["bars"]] == [qualified, True]


def test_the_verdict_goes_into_report_card_and_manifest(tmp_path):
    path = model(tmp_path / "actor.onnx", 0.5)
    path.with_suffix(".json").write_text('{"own": 1}')
    path.with_suffix(".md").write_text("# Actor\n\nStatus: **provisional**.\n")
    (tmp_path / "manifest.json").write_text("{}")
    for _ in range(2):  # a second verdict takes the place of the first
        qualify("actor", path, evaluate, ship=False, artifacts=tmp_path, bars=BARS)
    report, text = (
        json.loads(path.with_suffix(".json").read_text()),
        path.with_suffix(".md").read_text(),
    )
    assert report["own"] == 1
    assert report["frozen_evaluation"]["qualified"] is True
    assert "Status: **passed its sealed simulation test**" in text
    assert text.count("| share.right | 0.95 | least 0.9 | yes |") == 1
    listed = json.loads((tmp_path / "manifest.json").read_text())["files"]["actor.onnx"]
    assert listed["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_verdict_that_stands_already_leaves_every_byte_alone(tmp_path):
    path, took = model(tmp_path / "actor.onnx", 0.5), iter((0.2, 0.3, 0.3))
    path.with_suffix(".json").write_text("{}")
    path.with_suffix(".md").write_text("# Actor\n\nStatus: **provisional**.\n")
    timed = Bars(7, 3, BARS.better, [*BARS.bar, Bar("milliseconds_per_call", most=1.0)])

    def judged(file, seed, size, error=0.0):
        report = evaluate(file, seed, size)
        return report | {"milliseconds_per_call": next(took), "error": report["error"] + error}

    def files():
        return {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    qualify("actor", path, judged, ship=False, artifacts=tmp_path, bars=timed)
    first = files()
    qualify("actor", path, judged, ship=False, artifacts=tmp_path, bars=timed)
    assert files() == first  # another latency, the same verdict
    qualify(
        "actor", path, lambda *a: judged(*a, error=0.1), ship=False, artifacts=tmp_path, bars=timed
    )
    assert files()["actor.json"] != first["actor.json"]  # the same bars hold, by another figure


def test_a_shipped_model_of_another_physics_is_replaced_without_comparing(tmp_path):
    model(tmp_path / "artifacts" / "actor.onnx", 0.1, physics="0")
    newer = model(tmp_path / "new" / "actor.onnx", 0.5)
    (newer.parent / "actor_ddpg.onnx").write_bytes(b"beside")
    qualify("actor", newer, evaluate, ship=True, artifacts=tmp_path / "artifacts", bars=BARS)
    assert metadata(tmp_path / "artifacts" / "actor.onnx")["physics_version"] == PHYSICS_VERSION
    assert (tmp_path / "artifacts" / "actor_ddpg.onnx").read_bytes() == b"beside"


def test_a_qualified_file_still_answers_alike(tmp_path):
    path = model(tmp_path / "actor.onnx", 0.5)
    x = np.linspace(-1, 1, 5, dtype=np.float32)[:, None]
    before = export.session(path).run(None, {"a": x})[0]
    qualify("actor", path, evaluate, ship=False, bars=BARS)
    assert np.array_equal(export.session(path).run(None, {"a": x})[0], before)


def test_it_replaces_the_shipped_model_only_if_not_worse(tmp_path):
    shipped = model(tmp_path / "artifacts" / "actor.onnx", 0.5)
    worse, better = (model(tmp_path / str(error) / "actor.onnx", error) for error in (0.6, 0.4))
    bytes_before = shipped.read_bytes()
    with pytest.raises(QualifyError, match=r"error = 0\.6, the shipped model reaches 0\.5"):
        qualify("actor", worse, evaluate, ship=True, artifacts=shipped.parent, bars=BARS)
    assert shipped.read_bytes() == bytes_before
    assert metadata(worse)["status"] == "provisional"
    qualify("actor", better, evaluate, ship=True, artifacts=shipped.parent, bars=BARS)
    assert metadata(shipped)["status"] == "qualified"
    listed = json.loads((shipped.parent / "manifest.json").read_text())["files"]["actor.onnx"]
    assert listed["bytes"] == shipped.stat().st_size


@pytest.mark.parametrize(
    ("new", "old", "ships"),
    [
        ((0.6, 0.95), (0.5, 0.85), True),
        ((0.5, 0.85), (0.6, 0.95), False),
        ((0.6, 0.85), (0.5, 0.85), False),
    ],
)
def test_one_that_keeps_every_bar_comes_before_one_that_does_not(tmp_path, new, old, ships):
    shipped = model(tmp_path / "artifacts" / "actor.onnx", old[0])
    newer = model(tmp_path / "new" / "actor.onnx", new[0])
    right = dict((new, old))

    def judged(path, seed, size):
        report = evaluate(path, seed, size)
        return report | {"share": {"right": right[report["error"]]}}

    if ships:
        qualify("actor", newer, judged, ship=True, artifacts=shipped.parent, bars=BARS)
        assert metadata(shipped)["status"] == "qualified"
    else:
        with pytest.raises(QualifyError, match="it stays; nothing was changed"):
            qualify("actor", newer, judged, ship=True, artifacts=shipped.parent, bars=BARS)


def test_another_physics_and_damaged_files_are_refused(tmp_path):
    with pytest.raises(QualifyError, match="physics_version '0'"):
        qualify(
            "actor",
            model(tmp_path / "actor.onnx", 0.5, physics="0"),
            evaluate,
            ship=False,
            bars=BARS,
        )
    torn = tmp_path / "torn.onnx"
    torn.write_bytes(b"\x08\x01torn")
    with pytest.raises(QualifyError, match=r"torn\.onnx: no model that can be read"):
        qualify("actor", torn, evaluate, ship=False, bars=BARS)


def test_a_figure_that_the_report_lacks_does_not_pass():
    assert figure({"a": {"b": 1}}, "a.b") == 1.0
    assert figure({"a": 1}, "a.b") is None
    assert not Bar("a.b", most=1.0).holds(None)


def test_bars_name_every_kind_and_a_limit_each():
    bars = load_bars()
    assert set(bars) == {"surrogate", "surrogate_fed", "predictor", "classifier", "actor"}
    assert all(
        (bar.least is None) != (bar.most is None) for kind in bars.values() for bar in kind.bar
    )


class Some(TrainerSettings, frozen=True):
    points: int = 3


def test_kept_work_is_done_once_and_draws_on(tmp_path):
    """A killed run continued makes the same numbers as one that was left alone."""
    done = []

    def train(run, stop_after=None):
        rng = np.random.default_rng(run.seed)
        parts = []
        for name in ("a", "b", "c"):
            if name == stop_after:
                raise KeyboardInterrupt
            parts.append(
                run.kept(name, lambda n=name: (done.append(n), rng.normal(size=2))[1], rng)
            )
        return np.concatenate(parts)

    whole = train(TrainingRun(tmp_path / "one", "some", 5, Some(), smoke=False))
    done.clear()
    with pytest.raises(KeyboardInterrupt):
        train(TrainingRun(tmp_path / "two", "some", 5, Some(), smoke=False), stop_after="c")
    assert np.array_equal(
        train(TrainingRun(tmp_path / "two", "some", 5, Some(), smoke=False, resume=True)), whole
    )
    assert done == ["a", "b", "c"]
    assert np.array_equal(
        train(TrainingRun(tmp_path / "two", "some", 5, Some(), smoke=False)), whole
    )
    assert done == ["a", "b", "c"] * 2  # without --resume everything is done again


class Gone:
    """Stands for a class that a later version of the code no longer has."""


def test_a_checkpoint_of_other_code_is_named_and_left_alone(tmp_path, monkeypatch):
    path = tmp_path / "films.ckpt"
    checkpoint.save(path, Gone())
    monkeypatch.delattr(f"{__name__}.Gone")
    with pytest.raises(checkpoint.CheckpointError, match=r"films\.ckpt.*another version.*delete"):
        checkpoint.load(path)


def test_a_damaged_checkpoint_is_named_and_left_alone(tmp_path):
    run = TrainingRun(tmp_path, "some", 0, Some(), smoke=False)
    run.kept("films", lambda: [1, 2, 3])
    path = run.folder / "checkpoints" / "films.ckpt"
    damaged = path.read_bytes()[:-1]
    path.write_bytes(damaged)
    with pytest.raises(checkpoint.CheckpointError, match=r"films\.ckpt.*damaged.*delete"):
        TrainingRun(tmp_path, "some", 0, Some(), smoke=False, resume=True).kept(
            "films", lambda: [1, 2, 3]
        )
    assert path.read_bytes() == damaged


def test_resuming_wants_the_same_settings(tmp_path):
    with pytest.raises(SettingsError, match="nothing to resume"):
        TrainingRun(tmp_path, "some", 0, Some(), smoke=False, resume=True)
    TrainingRun(tmp_path, "some", 0, Some(), smoke=False)
    with pytest.raises(SettingsError, match="other settings"):
        TrainingRun(tmp_path, "some", 0, Some(points=4), smoke=False, resume=True)


def test_metrics_go_to_csv_and_tensorboard(tmp_path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run = TrainingRun(tmp_path, "some", 0, Some(), smoke=False, config=tmp_path / "mine.toml")
    run.log({"step": 10, "return": 1.5, "why": "patience"})
    run.log({"step": 20, "return": 2.5, "why": "patience"})
    run.close()
    events = EventAccumulator(str(run.folder / "tensorboard"))
    events.Reload()
    assert [(e.step, e.value) for e in events.Scalars("return")] == [(10, 1.5), (20, 2.5)]
    assert (run.folder / "metrics.csv").read_text().splitlines()[0] == "step,return,why"
    assert run.command == f"orbitd train some --seed 0 --config {tmp_path / 'mine.toml'}"


def test_damaged_films_are_named_and_left_alone(tmp_path):
    from dataclasses import dataclass

    from models.film.cache import kept

    @dataclass
    class Films:
        force: np.ndarray

    kept(tmp_path, "films", 1, Films, lambda: Films(np.ones(3)))
    (path,) = tmp_path.glob("films-*.npz")
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(checkpoint.CheckpointError, match=r"films-.*damaged.*delete"):
        kept(tmp_path, "films", 1, Films, lambda: Films(np.ones(3)))
    assert path.stat().st_size == 50


def test_a_call_is_timed(tmp_path):
    assert 0.0 < export.milliseconds_per_call(model(tmp_path / "actor.onnx", 0.5), calls=5) < 1000.0
