"""The classifier's graph and its recordings."""

import numpy as np
import pytest

from firmware_py.acquire.features import FEATURE_NAMES
from models.recordings import Plan, record_builds, training_cases


def two_builds(workers=1):
    return record_builds(Plan("bench", 5, 5000, 1.1, training_cases), range(2), workers, lambda _: None)


def test_recordings_follow_from_the_seed_and_are_whole():
    first, second = two_builds(), two_builds()
    np.testing.assert_array_equal(first.orders.features, second.orders.features)
    first.orders.subset(first.orders.kind == 0).check()
    assert first.orders.features.shape[1] == len(FEATURE_NAMES)
    assert len(np.unique(first.raw.recording)) == len(first.raw) == 10
    assert first.raw.features.shape[1] == 800 * 8


@pytest.mark.slow
def test_recordings_do_not_depend_on_the_number_of_workers():
    np.testing.assert_array_equal(two_builds(2).orders.features, two_builds(1).orders.features)


def test_recordings_are_kept_and_read_back(tmp_path):
    from models.data_cache import recorded

    plan = Plan("bench", 6, 5000, 1.1, training_cases)
    made, read = recorded(tmp_path, plan, 1, 1), recorded(tmp_path, plan, 1, 1)
    assert len(list(tmp_path.iterdir())) == 1
    np.testing.assert_array_equal(made.orders.features, read.orders.features)
    np.testing.assert_array_equal(made.raw.kind, read.raw.kind)


@pytest.mark.slow
def test_one_file_answers_like_the_module(tmp_path):
    import torch

    from models import export
    from models.diagnosis_network import Diagnosis
    from models.network import Mlp

    rng, n = np.random.default_rng(0), len(FEATURE_NAMES)
    net = Mlp((n, 12, 4))
    module = Diagnosis(
        rng.normal(size=n), rng.uniform(0.1, 2.0, n), net.layers(net.initial(rng)), 1.3, rng.normal(size=(n, n))
    )
    metadata = export.Metadata("classifier", "0", FEATURE_NAMES, ("heads", "score"), {}, (), "", {}, ())
    path, x = tmp_path / "classifier.onnx", rng.normal(0.0, 5.0, (10_000, n)).astype(np.float32)
    x[0], x[1] = 0.0, 1e6
    export.export(
        module, torch.from_numpy(x[:2]), path, input_name="features", output_names=("heads", "score"), metadata=metadata
    )
    assert export.parity(module, path, x) <= 1e-6
    heads, score = export.session(path).run(None, {"features": x})
    assert heads.shape == (10_000, 4)
    assert score.shape == (10_000, 1)
    assert ((heads >= 0) & (heads <= 1)).all()
