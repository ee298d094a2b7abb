"""Episodes that judge the predictor, what hears them, and the arithmetic of its scores."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_py.brain.film import Film, Points
from firmware_py.brain.intervals import QUANTITIES, REGIMES
from models.prediction import predictor
from models.prediction.episodes import FORECASTS_S, after_procedure, draw, play, slow_roll_vectors
from models.prediction.hearing import Said, join, listen
from models.prediction.scores import conformal, intervals, report, rival_widths, winkler
from models.prediction.truth import damping_ratio
from sim_hil.plant.build import Build
from sim_hil.rigs import load_rig

RIG = load_rig("bench")


def test_episodes_follow_from_the_seed_and_regimes_take_turns():
    first, again, other = (draw(RIG, seed, 5) for seed in (1, 1, 2))
    assert (first.duty, first.clearance_m, first.seed) == (
        again.duty,
        again.clearance_m,
        again.seed,
    )
    assert first.duty != other.duty
    assert [draw(RIG, 1, k).regime for k in range(8)] == [*REGIMES, *REGIMES]
    for k in range(3, 40, 4):
        assert len(set(draw(RIG, 1, k).clearance_m)) == 1  # a fault grows at one clearance


def test_near_whirl_is_near_and_the_rest_is_not():
    for k in range(12):
        episode = draw(RIG, 3, k)
        _, speed, load = (
            values[-1]
            for values in (episode.duty.time_s, episode.duty.speed_rpm, episode.duty.load_N)
        )
        viscosity = RIG.oil.viscosity_at(episode.inlet_C + 2.0)
        film_m, ratio = damping_ratio(
            RIG, speed * math.pi / 30, load, episode.clearance_m[-1], viscosity
        )
        assert film_m > 10e-6
        assert (ratio < 0.13) == (episode.regime == "near_whirl")


def test_the_judges_film_agrees_with_the_devices():
    """Two ways to the same machine: the simulator's table by Newton here, the surrogate in the
    brain."""
    _, model = predictor.brain("bench")
    film = Film(
        model.session, RIG.bearing.radius_m, RIG.bearing.length_m, RIG.rotor.effective_mass_kg
    )
    for rpm, load, clearance in (
        (3000.0, 300.0, 60e-6),
        (12000.0, 30.0, 60e-6),
        (6000.0, 100.0, 120e-6),
    ):
        speed = rpm * math.pi / 30
        film_m, ratio = damping_ratio(RIG, speed, load, clearance, 0.008)
        steady = film.steady(Points(*(np.array([v]) for v in (speed, clearance, 0.008, load))))
        assert film_m == pytest.approx(clearance - np.hypot(*steady.position_m[0]), abs=0.1e-6)
        assert ratio == pytest.approx(steady.damping_ratio[0], abs=0.005)


def test_slow_roll_finds_the_runout():
    build = Build.draw(RIG, np.random.default_rng(4))
    found = slow_roll_vectors(RIG, build, seed=1)
    true = build.gain[:2] * build.runout_m[:, 0]
    assert np.abs(found) == pytest.approx(true, abs=0.15e-6)
    left = after_procedure(predictor.brain("bench")[0], RIG, build, np.random.default_rng(1))
    assert all(channel.zeroed for channel in left.machine.channel[:2])
    residual = [
        np.hypot(
            *(
                np.array(
                    [
                        c.slow_roll_um * np.cos(np.radians(c.slow_roll_deg)),
                        c.slow_roll_um * np.sin(np.radians(c.slow_roll_deg)),
                    ]
                )
                - 1e6 * np.array([v.real, v.imag])
            )
        )
        for c, v in zip(left.machine.channel[:2], slow_roll_vectors(RIG, build, 1), strict=True)
    ]
    assert max(residual) < 0.5  # what the reference leaves, 0.3 um, and the noise of two readings


def test_a_steady_machine_is_forecast_within_the_bars():
    episode = draw(RIG, 7, 0)
    recording = play(RIG, episode)
    config, model = predictor.brain("bench")
    zeroed = after_procedure(config, RIG, episode.build, np.random.default_rng(1))
    said = listen(RIG, episode, recording, model, zeroed)
    assert len(said.true) == len(FORECASTS_S)
    assert said.expected[:, 0] == pytest.approx(said.true[:, 0], rel=0.05)
    assert said.expected[:, 2] == pytest.approx(said.true[:, 2], abs=2e-6)
    persistence = np.abs(said.rivals[:, 0] - said.true)
    assert (
        np.abs(said.expected - said.true)[:, 1] < persistence[:, 1]
    ).all()  # runout is not motion


def spoken(n: int, seed: int, stretch: float) -> Said:
    """Forecasts whose errors are ``stretch`` deviations of a skewed law, episodes of two."""
    rng = np.random.default_rng(seed)
    deviation = rng.uniform(0.5, 2.0, (n, 4))
    expected = rng.uniform(50.0, 100.0, (n, 4))
    true = expected + deviation * stretch * (rng.exponential(1.0, (n, 4)) - 0.5)
    regime = np.array(REGIMES)[rng.integers(0, 4, n)]
    return Said(
        expected,
        deviation,
        true,
        np.repeat(expected[:, None] + 30.0, 3, axis=1),
        np.ones((n, 3, 3)),
        np.ones((n, 3)),
        np.full((n, 3), np.nan),
        np.repeat(np.arange(n // 2), 2),
        regime,
        regime,
    )


@pytest.mark.parametrize("stretch", [0.3, 3.0])
def test_conformal_factors_cover_what_they_say_whatever_the_errors_law(stretch):
    factors = conformal(spoken(4000, 1, stretch))
    fresh = spoken(4000, 2, stretch)
    low, high = intervals(fresh, factors)
    inside = (low <= fresh.true) & (fresh.true <= high)
    for regime in REGIMES:
        assert inside[fresh.regime == regime].mean(axis=0) == pytest.approx(
            np.full(4, 0.9), abs=0.03
        )
    low_side, high_side = factors["ramp"]["power_W"]
    assert high_side > 2 * low_side  # the law's tail is on one side, and so is the interval's


def test_a_regime_never_recognised_takes_the_factors_of_all():
    said = spoken(400, 1, 1.0)
    calm = Said(
        **{
            **{name: getattr(said, name) for name in said.__dataclass_fields__},
            "recognised": np.full(400, "steady"),
        }
    )
    factors = conformal(calm)
    assert factors["fault"] == factors["ramp"] == factors["near_whirl"]
    low, high = intervals(calm, dict.fromkeys(REGIMES, factors["fault"]))
    assert ((low <= calm.true) & (calm.true <= high)).mean() == pytest.approx(0.9, abs=0.02)


def test_a_regime_taken_for_another_is_covered_all_the_same():
    """A fifth of the faults, with errors twice as large, is taken for steady: both true regimes get
    90 %."""

    def mistaken(seed):
        said = spoken(8000, seed, 1.0)
        fault = said.regime == "fault"
        true = np.where(
            fault[:, None], said.expected + 2.0 * (said.true - said.expected), said.true
        )
        unseen = fault & (np.random.default_rng(seed + 9).random(8000) < 1 / 5)
        return replace(said, true=true, recognised=np.where(unseen, "steady", said.regime))

    factors, fresh = conformal(mistaken(1)), mistaken(2)
    low, high = intervals(fresh, factors)
    inside = (low <= fresh.true) & (fresh.true <= high)
    for regime in REGIMES:
        assert inside[fresh.regime == regime].mean(axis=0) == pytest.approx(
            np.full(4, 0.9), abs=0.03
        )


def test_the_worst_coverage_of_few_episodes_is_far_off_by_chance():
    rng = np.random.default_rng(0)
    few, many = (
        report(said, conformal(said), rival_widths(said), rng)[
            "coverage_worst_points_off_by_chance"
        ]
        for said in (spoken(600, 1, 1.0), spoken(12000, 1, 1.0))
    )
    assert few["median"] > 3.0 > 1.5 > many["median"]
    assert many["within_3_points"] > 0.95 > few["within_3_points"]


def test_interval_score_by_hand():
    score = winkler(np.array([1.0, 1.0, 1.0]), np.array([3.0, 3.0, 3.0]), np.array([2.0, 0.5, 4.0]))
    assert score == pytest.approx([2.0, 2.0 + 20 * 0.5, 2.0 + 20 * 1.0])


def test_report_names_who_is_beaten():
    said = spoken(400, 1, 1.0)
    found = report(said, conformal(said), rival_widths(said), np.random.default_rng(0))
    score = found["interval_score"]["all"]["power_W"]
    assert score["beats_persistence"]
    assert score["predictor"] < score["persistence"]
    assert set(found["coverage"]) == {"all", *REGIMES}
    assert set(found["coverage"]["all"]) == set(QUANTITIES)
    for regime, share in found["coverage_of_regime"].items():
        assert share == pytest.approx(np.mean(list(found["coverage"][regime].values())), abs=1e-4)
    json.dumps(found, allow_nan=False)


def test_joined_forecasts_keep_their_rows():
    a, b = spoken(10, 1, 1.0), spoken(6, 2, 1.0)
    assert np.array_equal(join([a, b]).true[10:], b.true)


def test_fisher_information_of_the_report():
    told = predictor.fisher("bench")
    for row in told.values():
        low, high = row["load_viscosity_eigenvalues_of_position_alone"]
        assert low < 1e-4 * high
        assert row["oil_temperature"]["load"] == 0.0


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_smoke_training_repeats_itself_and_an_interrupted_one_goes_on(tmp_path, capsys):
    from models.train import main

    files = []
    for out, more in (
        (tmp_path / "one", []),
        (tmp_path / "two", []),
        (tmp_path / "two", ["--resume"]),
    ):
        assert main(["predictor", "--smoke", "--seed", "3", "--out", str(out), *more]) == 0
        run = out / "predictor-seed3-smoke"
        assert {p.name for p in run.iterdir()} >= {
            "config.json",
            "metrics.csv",
            "predictor.json",
            "predictor.md",
            "data.md",
            "checkpoints",
            "tensorboard",
        }
        files.append((run / "predictor.json").read_bytes())
    assert files[0] == files[1] == files[2]
