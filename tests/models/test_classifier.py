"""The classifier's recordings, its graph, its words, and what is counted on watched machines."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_py.acquire.features import FEATURE_NAMES, GROUP_OF_FEATURE, GROUPS, features
from firmware_py.brain.verdict import WORDS, VerdictLimits
from firmware_py.config import read_machine
from models.diagnosis import recordings
from models.diagnosis.alarms import detection, false_alarms, find, held, onsets
from models.diagnosis.data_cache import load, make_recordings
from models.diagnosis.dataset import Dataset, DatasetError, join, pooled
from models.diagnosis.recordings import RecordingPlan, record_build, training_cases
from models.diagnosis.windowed import WindowSampling, usable_windows, views_of

BENCH = read_machine("bench")


PLAN = RecordingPlan("bench", 5, 5000, 1.1, training_cases)


def rows(n, seed=0, kind=0, **columns):
    rng = np.random.default_rng(seed)
    found = {
        "kind": np.full(n, kind),
        "severity": np.full(n, 100.0),
        "group": np.zeros(n, int),
        "recording": np.zeros(n, int),
        "loop": np.zeros(n, int),
        "duty": np.zeros(n, int),
        "bad": np.zeros(n, bool),
    }
    return Dataset(rng.normal(size=(n, len(FEATURE_NAMES))), **(found | columns))


def test_recordings_follow_from_plan_and_build_and_are_kept(tmp_path):
    files = make_recordings(tmp_path, PLAN, 2, 1, lambda _: None)
    again = record_build(PLAN, 1)
    kept = load(files[1])
    assert [raw.kind for raw in kept] == [raw.kind for raw in again]
    np.testing.assert_array_equal(kept[2].counts, again[2].counts)
    np.testing.assert_array_equal(kept[2].marks_us, again[2].marks_us)
    stamp = files[0].stat().st_mtime_ns
    make_recordings(tmp_path, PLAN, 2, 1, lambda _: None)
    assert files[0].stat().st_mtime_ns == stamp


def test_views_hold_every_recording_and_are_read_back(tmp_path):
    look = WindowSampling(raw_builds=1)
    made, read = views_of(tmp_path, PLAN, 1, 1, look), views_of(tmp_path, PLAN, 1, 1, look)
    np.testing.assert_array_equal(made.orders.features, read.orders.features)
    assert made.orders.features.shape[1] == len(FEATURE_NAMES)
    assert len(made.raw) == len(made.waves) == 6
    assert made.raw.features.shape[1] == 800 * 8
    assert np.isfinite(made.waves.features).all()
    decided = views_of(tmp_path, PLAN, 1, 1, WindowSampling(windows=2))
    assert len(decided.raw) == len(decided.waves) == 0
    np.testing.assert_array_equal(decided.orders.features, pooled(made.orders, 2).features)


def test_a_torn_recording_is_refused(tmp_path):
    file = tmp_path / "build-00000.npz"
    file.write_bytes(b"PK torn")
    with pytest.raises(DatasetError, match="delete it, it is then made again"):
        load(file)


def test_every_loop_moves_the_clearance_inside_the_bearing():
    from models.diagnosis.clearance_loops import LOOPS, loop_of
    from sim_hil.plant.build import Build
    from sim_hil.plant.duty import Duty
    from sim_hil.plant.machine import SimulatedMachine
    from sim_hil.rigs import load_rig

    rig = load_rig("bench")
    moved = {}
    for kind, name in enumerate(LOOPS):
        loop = loop_of(kind, rig, 1.5, np.random.default_rng(1))
        machine = SimulatedMachine(rig, Build.nominal(rig), 0, clearance_m=loop.start_m)
        batch = loop.run(machine, Duty.hold(3000.0, 100.0), 1.5, 1e5)
        clearance = batch.truth[:, 3]
        assert len(batch.counts) == 7500
        assert 39e-6 < clearance.min() <= clearance.max() < 161e-6
        moved[name] = np.ptp(clearance)
    assert moved["fixed"] < 2e-6
    assert min(moved["random actor"], moved["agent"]) > 5e-6


def test_features_do_not_depend_on_the_rate():
    """One machine without ambient noise, sampled at both rates: what turns with the shaft is the
    same."""
    from sim_hil.plant.build import Build
    from sim_hil.plant.duty import Duty
    from sim_hil.plant.runs import record
    from sim_hil.rigs import load_rig

    rig = load_rig("bench")
    found = []
    for rate in (5000, 10000):
        taken = record(
            rig,
            Build.nominal(rig),
            Duty.hold(6000.0, 150.0),
            1.5,
            clearance=6e-5,
            seed=3,
            rate_hz=rate,
        )
        status = np.column_stack(
            [taken.status[:, 0] * 1e6, taken.status[:, 3], taken.status[:, 1:3]]
        )
        raw = recordings.Raw(
            taken.counts,
            round(taken.time_s[0] * 1e6),
            np.round(taken.mark_s * 1e6).astype(np.int64),
            status,
            rate,
            0,
            100.0,
            0,
            0,
        )
        found.append(features(usable_windows(raw, "bench")[-1], BENCH))
    change = dict(zip(FEATURE_NAMES, np.abs(found[1] - found[0]), strict=True))
    for name in (
        "log_speed_rad_s",
        "log_shaft_fwd_1x_m",
        "acc_bearing_vertical_1x_per_shaft",
        "contact_1x_film",
    ):
        assert change[name] < 0.05, name
    levels = [
        change[f"{c}_ringing_log_psd"]
        for c in ("acc_bearing_vertical", "acc_bearing_horizontal", "acc_motor")
    ]
    assert max(levels) < 0.5


def builds(n, seed, **columns):
    """Rows of ten builds."""
    return rows(n, seed, group=np.arange(n) % 10, recording=np.arange(n), **columns)


def graph(seed=0):
    from models.diagnosis.graph import DiagnosisGraph
    from models.diagnosis.novelty import fit_novelty, fleet
    from models.learning.network import Mlp

    rng, n = np.random.default_rng(seed), len(FEATURE_NAMES)
    net, train, inner = (
        Mlp((n, 12, 4)),
        builds(240, 1, kind=np.arange(240) // 10 % 6),
        builds(40, 2),
    )
    residual, parts = fit_novelty(train, inner, 0.9)
    return DiagnosisGraph(
        rng.normal(size=n),
        rng.uniform(0.1, 2.0, n),
        net.layers(net.initial(rng)),
        np.full(4, 1.3),
        residual,
        parts,
        fleet(parts, residual(inner.features), 0.9),
    )


def test_the_operating_point_is_taken_out_of_the_features():
    from models.diagnosis.novelty import OPERATING_COLUMNS, Residual

    column = FEATURE_NAMES.index("contact_log_film")

    def healthy(n, seed):
        rng = np.random.default_rng(seed)
        x = rng.normal(size=(n, len(FEATURE_NAMES)))
        speed, clearance = x[:, OPERATING_COLUMNS[0]], x[:, OPERATING_COLUMNS[1]]
        x[:, column] = 2.0 + speed * clearance - speed**2 + np.exp(0.5 * speed) * rng.normal(size=n)
        return x

    residual = Residual.fit(healthy(3000, 0))
    far = residual(healthy(4000, 1))[:, column]
    speed = healthy(4000, 1)[:, OPERATING_COLUMNS[0]]
    for slow in (speed < -1.0, speed > 1.0):
        assert np.median(np.abs(far[slow])) == pytest.approx(0.6745, rel=0.25), (
            "the same scale at every speed"
        )
        assert abs(np.median(far[slow])) < 0.25


def test_novelty_in_the_graph_is_that_of_the_parts():
    import torch

    from models.diagnosis.novelty import fit_novelty, novelty

    train, inner, other = (
        builds(240, 1, kind=np.arange(240) // 10 % 6),
        builds(40, 2),
        builds(20, 3),
    )
    residual, parts = fit_novelty(train, inner, 0.9)
    assert np.mean(
        [part.distance(residual(inner.features)) > 1.0 for part in parts]
    ) == pytest.approx(0.1, abs=0.03)
    x = other.features.astype(np.float32)
    with torch.no_grad():
        _, score, _, normal, departures = (t.double().numpy() for t in graph()(torch.from_numpy(x)))
    np.testing.assert_allclose(score[:, 0], novelty(parts, residual(x)), rtol=1e-5)
    white = [residual(x) @ part.whitening - part.centres[0] for part in parts]
    np.testing.assert_allclose(normal, np.concatenate(white, axis=1), atol=1e-4)
    motor = residual(x)[:, GROUPS.index("acc_motor_orders") == GROUP_OF_FEATURE]
    np.testing.assert_allclose(
        departures[:, GROUPS.index("acc_motor_orders")], np.sqrt((motor**2).mean(axis=1)), 1e-5
    )
    assert (
        novelty(parts, residual(other.features + 6.0)) > novelty(parts, residual(other.features))
    ).all()


def test_a_fault_across_the_taught_ones_is_new_where_they_move_it_not_in_all_features():
    """What drowns in two hundred directions is seen in the few in which the taught faults lie
    apart."""
    from models.diagnosis.novelty import Part

    rng, kind, group = np.random.default_rng(0), np.arange(1200) // 10 % 4, np.arange(1200) % 120
    moved = np.zeros((4, 200))
    moved[1, 0] = moved[2, 1] = moved[3, 2] = 6.0
    data = rows(1200, kind=kind, group=group, recording=np.arange(1200))

    def new(directions):
        residual = rng.normal(size=(1200, 200)) + moved[kind]
        healthy, inner = rng.normal(size=(300, 200)), rng.normal(size=(1200, 200)) + moved[kind]
        part = Part.fit(np.ones(200, bool), directions, residual, data).limited(inner, 0.999)
        assert np.median(part.distance(healthy)) < 0.2
        return np.mean(part.distance(healthy - moved[1]) > 1.0)

    assert new(None) < 0.5
    assert new(3) > 0.9


def test_distances_of_one_feature_and_of_many_are_alike_improbable():
    """One in ten of ordinary rows lies beyond a third of the limit that one in a thousand
    passes."""
    from models.diagnosis.novelty import Part

    rng, group = np.random.default_rng(0), np.arange(4000) % 400
    data = rows(4000, group=group, recording=np.arange(4000))
    residual, inner, fresh = rng.normal(size=(3, 4000, 50))
    for columns in (np.arange(50) < 1, np.arange(50) < 50):
        away = Part.fit(columns, None, residual, data).limited(inner, 0.999).distance(fresh)
        assert np.mean(away > 1.0 / 3.0) == pytest.approx(0.1, abs=0.03)
        assert np.mean(away > 1.0) == pytest.approx(0.001, abs=0.002)


def test_builds_need_two_healthy_recordings():
    from models.diagnosis.novelty import fit_novelty

    alone = rows(10, 1, group=np.arange(10), kind=np.arange(10) % 2)
    with pytest.raises(DatasetError, match="no build has two healthy recordings"):
        fit_novelty(alone, alone, 0.9)


def test_drivers_are_what_a_head_loses_with_a_group():
    import torch

    module = graph()
    x = rows(3).features.astype(np.float32)
    with torch.no_grad():
        heads, _, drivers, *_ = (t.double().numpy() for t in module(torch.from_numpy(x)))
        at = GROUPS.index("acc_motor_ringing")
        without = np.where(at == GROUP_OF_FEATURE, module.mean.numpy(), x).astype(np.float32)
        less = module(torch.from_numpy(without))[0].double().numpy()
    lost = np.log(heads / (1 - heads)) - np.log(less / (1 - less))
    np.testing.assert_allclose(drivers.reshape(3, len(GROUPS), 4)[:, at], lost, atol=2e-4)


@pytest.mark.slow
def test_one_file_answers_like_the_module(tmp_path):
    import torch

    from models import export

    rng, n, module = np.random.default_rng(0), len(FEATURE_NAMES), graph()
    names = ("heads", "score", "drivers", "normal", "departures")
    metadata = export.Metadata("classifier", "0", FEATURE_NAMES, names, {}, (), "", {}, ())
    path, x = tmp_path / "classifier.onnx", rng.normal(0.0, 5.0, (10_000, n)).astype(np.float32)
    x[0], x[1] = 0.0, 1e6
    export.export(
        module,
        torch.from_numpy(x[:2]),
        path,
        input_name="features",
        output_names=names,
        metadata=metadata,
    )
    assert export.parity(module, path, x) <= 1e-6
    heads, score, *_ = export.session(path).run(None, {"features": x})
    assert heads.shape == (10_000, 4)
    assert score.shape == (10_000, 1)
    assert ((heads >= 0) & (heads <= 1)).all()


def verdicts(sure):
    """Unbalance where the first feature is positive, with ``sure`` log-odds."""

    def answer(features):
        heads = np.full((len(features), 4), 0.01)
        heads[:, 3] = 1 / (1 + np.exp(-np.where(features[:, 0] > 0, sure, -sure)))
        return heads, np.where(features[:, 1] > 5, 2.0, 0.5)

    return answer


LIMITS = VerdictLimits(novelty=1.0, named_above=np.full(5, 9.0))


def test_false_alarms_need_a_named_fault_and_persistence_to_be_confirmed():
    quiet = rows(50, recording=np.repeat([0, 1], 25), group=np.repeat([0, 1], 25))
    quiet.features[:] = -1.0

    def counted(sure=6.0, limits=LIMITS):
        return false_alarms(find(verdicts(sure), quiet), limits)

    assert (counted()["false_alarms"], counted()["confirmed_alarms"]) == (0, 0)
    assert counted()["builds_upper_95"] == pytest.approx(1 - 0.05 ** (1 / 2), abs=1e-4)
    quiet.features[25:, 0] = 1.0
    assert counted()["builds_with_a_false_alarm"] == counted()["confirmed_alarms"] == 1
    assert counted()["share_of_decisions"] == 0.5
    assert counted(0.3)["called_doubt"] == 1.0
    assert (
        counted(1.5)["called_doubt"] == 0.5
    )  # surely enough the best class, not surely enough abnormal
    assert counted(1.5, VerdictLimits(1.0, np.ones(5)))["false_alarms"] == 16
    quiet.features[:, 1] = 9.0
    assert counted()["called_unknown"] == 1.0


def test_a_bad_channel_is_no_fault_and_its_windows_have_no_vote():
    faulty = rows(25, kind=4)
    faulty.features[:] = -1.0
    faulty.features[:, 0] = 1.0
    faulty.bad[12] = True
    words = [WORDS[word] for word in find(verdicts(6.0), faulty).words(LIMITS)]
    assert words == ["unbalance"] * 3 + ["sensor_fault"] + ["doubt"] * 9 + ["unbalance"] * 3


def test_a_month_is_counted_in_operating_points_with_the_exact_binomial_limit():
    quiet = rows(
        25 * 40, recording=np.repeat(np.arange(40), 25), group=np.repeat(np.arange(40), 25)
    )
    quiet.features[:] = -1.0
    none = false_alarms(find(verdicts(6.0), quiet), LIMITS)
    assert none["confirmed_per_machine_month_upper_95"] == pytest.approx(
        720 * (1 - 0.05 ** (1 / 40)), abs=1e-2
    )
    quiet.features[:25, 0] = 1.0
    one = false_alarms(find(verdicts(6.0), quiet), LIMITS)
    assert (one["runs"], one["runs_with_a_confirmed_alarm"]) == (40, 1)
    assert one["confirmed_per_machine_month"] == 720 / 40
    limit = (
        one["confirmed_per_machine_month_upper_95"] / 720
    )  # 40 runs with so many alarms show one at most in 5 %
    assert (1 - limit) ** 40 + 40 * limit * (1 - limit) ** 39 == pytest.approx(0.05, abs=1e-4)


def test_long_runs_tell_how_many_scatters_a_held_point_lies_from_the_limits():
    rng = np.random.default_rng(0)
    long = rows(
        400,
        recording=np.repeat([0, 1], 200),
        group=np.repeat([0, 1], 200),
        duty=np.repeat([0, 1], 200),
    )
    long.features[:] = -1.0

    def answer(features):
        noise = rng.normal(0.0, 0.5, len(features))
        heads = np.full((len(features), 4), 1e-5)
        heads[:, 3] = 1 / (1 + np.exp(3.0 - noise))
        return heads, np.zeros(len(features))

    found = held(find(answer, long), LIMITS)
    assert (found["runs"], found["held_points"], found["confirmed_alarms"]) == (2, 1, 0)
    assert found["nearest_in_scatters"] == pytest.approx((3.0 + np.log(9.0)) / 0.5, rel=0.15)
    assert found["largest_scatter"] == pytest.approx(0.5, rel=0.15)


def test_detection_delay_counts_from_the_first_faulty_window():
    healthy, fault = (
        rows(13),
        rows(30, kind=4, severity=np.full(30, 16.0), recording=np.ones(30, int)),
    )
    healthy.features[:], fault.features[:] = -1.0, -1.0
    fault.features[:, 0] = 1.5
    heard = onsets(verdicts(6.0), join([healthy, fault]))
    found = detection(heard, LIMITS)["unbalance"]
    assert found["named_median_s"] == 0.25 * 5
    assert found["confirmed_median_s"] == 0.25 * 5 + 3.0
    assert (
        detection(heard, VerdictLimits(1.0, np.full(5, 1e9)))["unbalance"]["confirmed_median_s"]
        is None
    )


@pytest.mark.parametrize(
    "case",
    [
        recordings.RecordingCase(0, 100.0, {}),
        recordings.RecordingCase(4, 40.0, {"unbalance": 40.0}),
        recordings.RecordingCase(-1, 3, {"wear": 1.0}),
    ],
)
def test_the_judged_words_are_the_device_s(case):
    """One recording through the device's own diagnoser, and as the judge hears it."""
    from firmware_py.brain.diagnosis import Diagnoser
    from firmware_py.brain.session import Session
    from firmware_py.brain.store import Model, read_card
    from models import ARTIFACTS
    from models.diagnosis.judge import limits_of, of_file

    raw = record_build(RecordingPlan("bench", 3, 5000, 4.0, lambda rng: [case]), 0)[0]
    windows = [replace(w, end_ns=w.end_tick_us * 1000) for w in usable_windows(raw, "bench")]
    path = ARTIFACTS / "classifier.onnx"
    session = Session(path.name, path.read_bytes())
    diagnoser = Diagnoser(Model(read_card(path.name, session.metadata), session, "0" * 64), BENCH)
    device = [diagnoser.step(window)[0].verdict for window in windows][9:]
    data = rows(len(windows))
    bad = np.array([w.channel_ok != 0xFF for w in windows])
    data = replace(data, features=np.array([features(w, BENCH) for w in windows]), bad=bad)
    words = find(of_file(path), data).words(limits_of(path))
    assert [WORDS[word] for word in words] == device


def test_heads_of_their_own_features_see_no_others():
    from models.diagnosis.ladder import fit_heads, side_by_side

    data = rows(120, kind=np.arange(120) % 6, group=np.arange(120), recording=np.arange(120))
    own = np.zeros((len(FEATURE_NAMES), 4), bool)
    own[:3, 0] = own[3:6, 1] = own[6:9, 2] = own[9:12, 3] = True
    for hidden in (0, 3):
        two = [
            fit_heads("own", own, hidden, data, data, 1e-3, 15, np.random.default_rng(k))
            for k in (0, 1)
        ]
        changed = data.features.copy()
        changed[:, 3:6] += 1.0
        moved = np.abs(two[0].logits(changed) - two[0].logits(data.features)).max(axis=0)
        assert moved[1] > 1e-3
        assert np.delete(moved, 1).max() == 0.0
    mean = side_by_side("mean", two).logits(data.features)
    np.testing.assert_allclose(
        mean, np.mean([n.logits(data.features) for n in two], axis=0), rtol=1e-9, atol=1e-12
    )


def test_cross_fitted_log_odds_know_nothing_of_their_own_build():
    from models.diagnosis.ladder import ALL_FEATURES, cross_fitted, fit_heads

    data = rows(120, kind=np.arange(120) % 6, group=np.arange(120) // 6, recording=np.arange(120))
    like = fit_heads("all", ALL_FEATURES, 0, data, data, 1e-3, 3, np.random.default_rng(0))
    first = cross_fitted(like, data, 4, 5, 0)
    other = replace(data, kind=np.where(data.group == 0, 4, data.kind))
    changed = np.abs(cross_fitted(like, other, 4, 5, 0) - first).max(axis=1) > 1e-12
    assert not changed[data.group == 0].any()
    assert changed.any()
