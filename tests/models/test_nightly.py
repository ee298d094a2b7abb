"""Final figures by the whole device: what is flown, what is kept, what the table says."""

import json

import numpy as np
import pytest

from firmware_py.brain.store import Models, load_models
from firmware_py.brain.verdict import CLASSES
from models import nightly
from models.nightly import CLASSIFIER, POLICY, WIDEST, flown, key_of, read, scenario, table
from sim_hil.rigs import load_rig

RIG = load_rig("bench")


def row(number, run, **figures):
    return {"key": "k", "scenario": number, "run": run} | figures


def power(number, run, watt):
    return row(number, run, power_W=watt, violation_s=0.0, min_film_um=20.0, authority_share=1.0)


def test_a_scenario_follows_from_seed_and_number():
    policy, widest = (scenario(RIG, 3, 1, run) for run in (POLICY, WIDEST))
    assert (policy.seed, policy.duty) == (widest.seed, widest.duty)
    assert policy.build.mass == widest.build.mass
    assert scenario(RIG, 3, 2, POLICY).duty != policy.duty
    assert scenario(RIG, 4, 1, POLICY).build.mass != policy.build.mass


def test_the_classifier_meets_every_class_at_a_point_that_is_held():
    cases = [scenario(RIG, n, 1, CLASSIFIER) for n in range(len(CLASSES))]
    assert [case.fault[0] if case.fault else None for case in cases] == [
        None,
        "pedestal_bolt",
        "pedestal_two_bolts",
        "motor_bolt",
        "unbalance",
        "pedestal_and_motor_bolt",
    ]
    assert cases[1].build.mass == scenario(RIG, 1, 1, POLICY).build.mass
    assert len(set(cases[1].duty.speed_rpm)) == 1


def test_lines_of_other_models_and_torn_ones_are_left_out(tmp_path):
    path = tmp_path / "nightly.jsonl"
    lines = [json.dumps(row(0, POLICY)), json.dumps(row(1, POLICY) | {"key": "other"})]
    path.write_text("\n".join(lines) + '\n{"key": "k", "scen')
    assert read(path, "k") == [row(0, POLICY)]
    assert read(tmp_path / "none.jsonl", "k") == []


def test_another_model_is_another_table():
    models = load_models(RIG.config)
    assert key_of(models, 1) != key_of(Models(None, models.actor, models.surrogate), 1)
    assert key_of(models, 1) != key_of(models, 2)


def test_the_table_pairs_flights_and_says_how_many_there_are():
    rng = np.random.default_rng(0)
    rows = []
    for n, watt in enumerate(rng.uniform(40.0, 90.0, 12)):
        rows += [power(n, POLICY, watt), power(n, WIDEST, watt + 1.0)]
    lines = table(rows[:-1], 50)
    counts = {line.split()[0]: line.split()[1] for line in lines[1:3]}
    assert counts == {POLICY: "12/50", WIDEST: "11/50"}
    assert "policy less widest: -1.000 W [-1.000, -1.000] (95 %)" in lines


def test_a_class_is_right_by_share_of_decisions_and_real_figures_stand_beside():
    def named(number, name, words, confirmed, tripped=0.0):
        told = row(number, CLASSIFIER, words=words, confirmed=confirmed, tripped=tripped)
        return told | {"class": name}

    text = "\n".join(
        table(
            [
                named(0, "normal", {"normal": 20}, ["normal"]),
                named(4, "unbalance", {"unbalance": 15, "doubt": 5}, ["unbalance"]),
                named(10, "unbalance", {"normal": 20}, ["normal"]),
                named(16, "unbalance", {"none": 20}, [], tripped=1.0),
            ],
            50,
        )
    )
    assert "4/50 flights, 1 of them tripped by the guard" in text
    assert "0.25 right, confirmed alone in 1 of 3; doubt 0.08, normal 0.33, none 0.33" in text
    assert f"mean over classes {0.5 * (1.0 + 0.25):.3f}" in text
    assert "0.28 over four classes" in text


@pytest.mark.slow
def test_the_whole_device_flies_a_scenario(monkeypatch):
    monkeypatch.setattr(nightly, "DUTY_S", 2.0)
    config = RIG.config
    found = flown(RIG, config, load_models(config), 0, 1, POLICY)
    assert found["authority_share"] > 0.9
    assert found["violation_s"] == found["tripped"] == found["refused"] == 0.0
    assert 10.0 < found["power_W"] < 300.0
