"""Commissioning judged: machines with an offset of their own, faults that only who knows the
machine sees."""

from types import SimpleNamespace

import numpy as np
import pytest

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.brain.normal import NormalError
from firmware_py.brain.verdict import WINDOWS
from models.diagnosis import commissioning
from models.diagnosis.commissioning import HEALTHY, LEARNED, POINTS
from models.diagnosis.dataset import Dataset
from tests.brain.onnx_models import classifier

MOTOR, SPEED = FEATURE_NAMES.index("acc_motor_log_rms"), FEATURE_NAMES.index("log_speed_rad_s")


@pytest.fixture
def rows(monkeypatch):
    """Ten builds: a motor as loud as nobody else's, and a fault that makes it 0.1 decades
    louder."""
    rng = np.random.default_rng(0)
    cases = commissioning.commissioned_cases(rng)
    builds, n = 10, len(cases)
    x = np.zeros((builds, n, len(FEATURE_NAMES)))
    x[..., SPEED] = 2.2 + 0.8 * rng.random((builds, n))
    x[..., FEATURE_NAMES.index("clearance_100um")] = 0.6
    x[..., FEATURE_NAMES.index("oil_outlet_50C")] = 0.4 + 0.2 * np.arange(n)
    x[..., FEATURE_NAMES.index("microphone_log_rms")] = -1.2
    for name in ("shaft_half_fwd_rms", "shaft_half_bwd_rms"):
        x[..., FEATURE_NAMES.index(name)] = -2.0
    faulty = np.array([case.kind < 0 for case in cases])
    x[..., MOTOR] = (
        0.1
        + 0.2 * rng.normal(size=(builds, 1))
        + 0.01 * rng.normal(size=(builds, n))
        + 0.1 * faulty
    )
    group = np.repeat(np.arange(builds), n)
    found = Dataset(
        x.reshape(-1, len(FEATURE_NAMES)).astype(np.float32),
        np.tile([case.kind for case in cases], builds),
        np.tile([float(case.severity) for case in cases], builds),
        group,
        100 * group + np.tile(np.arange(n), builds),
        np.zeros(builds * n, int),
        np.zeros(builds * n, int),
        np.zeros(builds * n, bool),
    )
    windows = found.subset(np.repeat(np.arange(len(found)), WINDOWS))
    monkeypatch.setattr(commissioning, "views_of", lambda *_: SimpleNamespace(orders=windows))
    return found


def test_cases_are_learned_first_and_judged_after():
    cases = commissioning.commissioned_cases(np.random.default_rng(1))
    assert all(case.kind == 0 for case in cases[: LEARNED + HEALTHY])
    assert [case.kind for case in cases[-5:]] == [1, 2, 3, 4, 5]
    assert sum(case.kind < 0 for case in cases) == 10


def test_recordings_at_the_same_point_count_once_and_more_are_taken(rows):
    rows.features[:4, FEATURE_NAMES.index("oil_outlet_50C")] = 0.5
    rows.features[:4, SPEED] = 2.5
    mine = np.flatnonzero(rows.group == 0)
    assert list(commissioning.first_points(rows, mine, 4)) == list(range(7))
    assert len(commissioning.first_points(rows, mine, LEARNED)) == LEARNED
    assert len(commissioning.first_points(rows, mine, 0)) == 0


def test_who_knows_the_machine_sees_what_the_fleet_hides(rows, tmp_path):
    path = tmp_path / "classifier.onnx"
    path.write_bytes(classifier(fleet=True))
    report = commissioning.judge(path, "bench", 5000, 10, 1, 0, tmp_path)
    assert list(report) == [f"{n} operating points" for n in POINTS]
    fleet, known = report["0 operating points"], report[f"{LEARNED} operating points"]
    assert fleet["wear"]["auroc"] < 0.75
    assert known["wear"]["auroc"] > 0.99
    assert known["wear"]["called_unknown"] > 0.9
    assert known["healthy_called_unknown"] < 0.05
    assert known["wear"]["decisions"] == 20


def test_a_file_without_statistics_is_refused(rows, tmp_path):
    path = tmp_path / "classifier.onnx"
    path.write_bytes(classifier())
    with pytest.raises(
        NormalError, match=r"classifier.onnx: carries no statistics of healthy machines"
    ):
        commissioning.judge(path, "bench", 5000, 1, 1, 0, tmp_path)
