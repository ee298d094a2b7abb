"""The environments behind the guard's shield, judged episodes, and the policies that are
compared."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from firmware_py.guard.envelope.retreat import Ramp
from models.control.episodes import Board, FixedSetting, Score, play, play_all, untripped
from models.control.judge import Bench
from models.control.predictive import ModelPredictive
from models.control.rivals import AdaptivePI, EccentricityPI, Fed, Lookup
from models.control.shielded import (
    ANNOUNCED_S,
    ShieldAdapter,
    ShieldedRotor,
    ShieldedRotors,
    column,
    config_of,
    fast_ramps,
)
from sim_hil.gym.control_task import OBSERVATIONS, EpisodeLimits, actions_of
from sim_hil.gym.environment import RotorEnv
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rigs import load_rig

REACH = (40e-6, 160e-6)


def light_and_fast() -> Duty:
    return Duty.hold(12000.0, 30.0, 5.0)


def seen(**values: float) -> np.ndarray:
    """One observation; what is not named is 0."""
    observation = np.zeros((1, len(OBSERVATIONS)), np.float32)
    for name, value in values.items():
        observation[0, column(name)] = value
    return observation


def test_shield_keeps_the_widest_clearance_from_a_fast_light_rotor() -> None:
    environment = ShieldedRotor(RotorEnv(episode_s=1.0, duty=light_and_fast()))
    environment.reset(seed=1)
    for _ in range(8):
        *_, info = environment.step(np.array([1.0], np.float32))
    assert info["intervened"]
    assert info["clearance_m"] < 70e-6


def test_one_rotor_of_many_meets_the_same_shield_as_one_alone() -> None:
    environment = ShieldedRotors(RotorVectorEnv(3, episode_s=2.0))
    observation, _ = environment.reset(seed=5)
    keepers = [
        ShieldAdapter(load_rig("bench").config, episode.duty)
        for episode in environment.rotors.episodes
    ]
    wish = actions_of(load_rig("bench"), np.full((3, 1), 160e-6))
    for step in range(4):
        expected = [
            keeper.admitted(o, 0.1 * step, 160e-6)
            for keeper, o in zip(keepers, observation, strict=True)
        ]
        assert environment._admitted(np.full(3, 160e-6)).tolist() == expected
        observation, *_ = environment.step(wish)


def test_an_ended_episode_gets_its_own_announcements_and_time() -> None:
    environment = ShieldedRotors(RotorVectorEnv(2, episode_s=0.2))
    environment.reset(seed=5)
    wish = actions_of(load_rig("bench"), np.full((2, 1), 60e-6))
    before = list(environment._keepers)
    environment.step(wish)
    assert environment._keepers == before
    environment.step(wish)
    assert not set(environment._keepers) & set(before)
    assert environment._time_s.tolist() == [0.0, 0.0]


def test_only_ramps_beyond_the_declared_ones_are_announced() -> None:
    config = load_rig("bench").config
    slow = Duty((0.0, 5.0, 6.0), (6000.0, 6000.0, 7900.0), (100.0, 100.0, 51.0))
    assert fast_ramps(config, slow) == []
    ramps = fast_ramps(config, Duty.published(load_rig("bench")))
    assert len(ramps) == 5
    assert ramps[0] == Ramp(12.0, 14.0, pytest.approx(6000 * RAD_S_PER_RPM), 100.0)


def test_behind_a_groove_the_shield_counts_what_that_adds_and_claims_nothing_of_friction() -> None:
    alone, fed = load_rig("bench").config, config_of(load_rig("bench"), fed=True)
    assert fed.machine.feed.groove_area_max_mm2 > fed.machine.feed.groove_area_min_mm2 > 0.0
    assert alone.machine.feed.groove_area_max_mm2 == 0.0
    assert fed.machine.bearing.friction_error_share == 1.0
    assert config_of(load_rig("bench"), fed=False) == alone


@pytest.mark.parametrize("pressure_Pa", [0.5e5, 3e5])
def test_the_widest_wish_breaks_no_limit_behind_the_shield_of_a_fed_bearing(
    pressure_Pa: float,
) -> None:
    """Machines of which some whirl without it at the one pressure, others lack film at the
    other."""
    board, seeds, policy = (
        Board("bench", 6.0, pressure=True),
        (7100001, 7100035, 7100045),
        FixedSetting(160e-6, pressure_Pa),
    )
    alone, behind = (
        play(board, seeds, policy, shielded=shielded).violation_s for shielded in (False, True)
    )
    assert alone.sum() > 0.0
    assert behind.sum() == 0.0


def test_an_announced_ramp_narrows_before_it_starts_and_is_over_after_its_end() -> None:
    config = load_rig("bench").config
    duty = Duty(
        (0.0, 10.0, 11.0, 20.0), (6000.0, 6000.0, 12000.0, 12000.0), (100.0, 100.0, 30.0, 30.0)
    )
    keeper = ShieldAdapter(config, duty)
    observation = seen(
        speed_rad_s=6000 * RAD_S_PER_RPM,
        clearance_m=80e-6,
        oil_outlet_C=41.0,
        eccentricity_x_m=30e-6,
        eccentricity_y_m=-28e-6,
    )[0]
    free = keeper.interval(observation, 10.0 - ANNOUNCED_S - 0.1)
    ready = keeper.interval(observation, 9.9)
    assert free is not None
    assert ready is not None
    assert ready[1] < free[1] - 20e-6
    assert keeper.interval(observation, 15.0) == free


def test_same_episodes_give_the_same_score_and_the_shield_tells_where_it_intervened() -> None:
    board = Board("bench", 1.0)
    first, second = (
        play(board, range(3, 6), FixedSetting(160e-6), shielded=True) for _ in range(2)
    )
    assert msgspec.to_builtins(first.power_W.tolist()) == second.power_W.tolist()
    assert first.power_W.shape == (3,)
    assert first.intervened.max() > 0
    assert (play(board, range(3, 6), FixedSetting(50e-6), shielded=False).intervened == 0).all()


def test_a_score_sums_time_in_violation_and_keeps_the_worst() -> None:
    ones = np.ones(2)
    film_m = 1e-6 * np.array([12.0, 9.0])
    score = Score(np.array([50.0, 70.0]), np.array([0.0, 0.3]), film_m, 0.1 * ones, 0 * ones, ones)
    summary = score.summary(20.0)
    assert summary["power_W"] == 60.0
    assert summary["violation_s"] == pytest.approx(0.3)
    assert summary["min_film_um"] == 9.0
    assert score.kept(np.array([True, False])).summary(20.0)["episodes_in_violation"] == 0.0
    limits = untripped(load_rig("bench"))
    assert score.depth(limits).tolist() == [0.0, pytest.approx(0.1)]


def test_episodes_come_back_in_their_order_policy_by_policy() -> None:
    board, seeds = Board("bench", 0.3), range(40, 53)
    played = [(FixedSetting(50e-6), True), (FixedSetting(70e-6), False)]
    scores = play_all(board, seeds, played, 1, lambda done: None)
    for (policy, shielded), score in zip(played, scores, strict=True):
        alone = play(board, seeds[11:12], policy, shielded=shielded)
        assert score.power_W.shape == (13,)
        assert score.power_W[11] == alone.power_W[0]


def test_with_the_pressure_its_pump_counts_and_the_shield_still_keeps_the_clearance() -> None:
    board = Board("bench", 0.5, pressure=True)
    low, high = (
        play(board, [3], Fed(FixedSetting(160e-6), p), shielded=True) for p in (0.5e5, 3e5)
    )
    assert low.power_W[0] < high.power_W[0]
    assert low.intervened[0] == 1.0
    assert board.reach.shape == (2, 2)


def test_direct_reynolds_confirms_the_table() -> None:
    board = Board("bench", 0.3)
    table, direct = (
        play(b, [3], FixedSetting(60e-6), shielded=False)
        for b in (board, replace(board, direct=True))
    )
    assert table.power_W[0] != direct.power_W[0]
    assert table.power_W[0] == pytest.approx(direct.power_W[0], rel=2e-3)
    assert table.min_film_m[0] == pytest.approx(direct.min_film_m[0], abs=0.1e-6)


def test_rejected_episodes_are_told_beyond_the_least_violation() -> None:
    def score(*violation_s: float) -> Score:
        ones = np.ones(2)
        film_m = 10e-6 - 1e-6 * np.array(violation_s)
        return Score(50.0 * ones, np.array(violation_s), film_m, 0 * ones, 0 * ones, ones)

    counted = np.array([True, False])
    bench = Bench(
        Board("bench", 20.0),
        [1, 2],
        counted,
        {"causal": np.array([40.0])},
        FixedSetting(60e-6),
        Score(*(np.full(1, v) for v in (60.0, 0.0, 2e-5, 0.1, 0.0, 0.0))),
        np.array([0.0, 1.0]),
        np.array([0.0, 0.1]),
    )
    figures = bench.figures(score(0.0, 3.0))
    assert figures["violation_s"] == 0.0
    assert figures["rejected_violation_s_beyond"] == pytest.approx(2.0)
    assert figures["rejected_depth_beyond"] == pytest.approx(0.2)
    assert figures["gap_share_causal"] == pytest.approx(0.5)


@pytest.mark.parametrize("kind", [EccentricityPI, AdaptivePI])
def test_the_controller_widens_a_bearing_that_runs_too_centred(kind: type[EccentricityPI]) -> None:
    controller = kind(0.4, 40e-6, 60e-6, REACH)

    def wish(ratio: float) -> float:
        controller.start(1)
        observation = seen(clearance_m=80e-6, eccentricity_x_m=80e-6 * ratio, peak_to_peak_x_m=2e-6)
        for _ in range(20):
            answer = controller(observation)
        return float(answer[0, 0])

    assert REACH[0] <= wish(0.9) < wish(0.05) <= REACH[1]


def test_the_adaptive_controller_backs_off_from_vibration() -> None:
    def wish(swing_m: float) -> float:
        controller = AdaptivePI(0.4, 40e-6, 60e-6, REACH)
        controller.start(1)
        for _ in range(20):
            answer = controller(
                seen(clearance_m=80e-6, eccentricity_x_m=30e-6, peak_to_peak_x_m=swing_m)
            )
        return float(answer[0, 0])

    assert wish(60e-6) < wish(5e-6)


def test_the_table_is_met_at_its_knots_and_straight_between_in_the_logarithm() -> None:
    torch = pytest.importorskip("torch")
    rig = load_rig("bench")
    table = np.array([[50e-6, 60e-6], [70e-6, 100e-6]])[:, :, None]
    module = Lookup(rig, table)

    def at(rpm: float, load_N: float) -> float:
        observation = seen(speed_rad_s=rpm * RAD_S_PER_RPM, load_estimate_N=load_N)
        return float(module(torch.from_numpy(observation))[0, 0])

    assert at(rig.speed_min_rpm, rig.load_min_N) == pytest.approx(50e-6, rel=1e-5)
    assert at(rig.speed_max_rpm, rig.load_max_N) == pytest.approx(100e-6, rel=1e-5)
    middle = (
        (rig.speed_min_rpm * rig.speed_max_rpm) ** 0.5,
        (rig.load_min_N * rig.load_max_N) ** 0.5,
    )
    assert at(*middle) == pytest.approx(table.mean(), rel=1e-4)
    assert at(2 * rig.speed_max_rpm, 10.0) == pytest.approx(70e-6, rel=1e-5)


@pytest.mark.slow
def test_model_predictive_choice_avoids_whirl_without_the_shield() -> None:
    board = Board("bench", 0.6)
    environment = ShieldedRotors(
        RotorVectorEnv(1, episode_s=0.6, duty=light_and_fast()), shielded=False
    )
    observation, _ = environment.reset(seed=1)
    policy = ModelPredictive("bench")
    policy.start(1)
    for _ in range(4):
        wish = policy(observation)
        observation, *_ = environment.step(actions_of(board.data, wish))
    assert board.reach[0, 0] <= wish[0, 0] < 80e-6


@pytest.mark.slow
@pytest.mark.parametrize("pressure", [False, True])
def test_one_file_answers_like_the_module_inside_the_rigs_range(tmp_path, pressure):
    import torch

    from models import export
    from models.control.policies import (
        OUTPUTS,
        BoundedSettings,
        Columns,
        OfFile,
        OfModule,
        random_observations,
        scale,
    )
    from models.learning.ddpg import Actor

    torch.manual_seed(3)
    reach = Board("bench", 1.0, pressure).reach
    outputs = OUTPUTS[: reach.shape[1]]
    actor = Actor(scale(load_rig("bench")), len(outputs), (32, 32))
    torch.nn.init.normal_(actor.net[-1].weight, std=0.5)
    module = BoundedSettings(actor, reach)
    metadata = export.Metadata("actor", "0", tuple(OBSERVATIONS), outputs, {}, (), "", {}, ())
    path, columns = tmp_path / "actor.onnx", Columns(module, len(outputs))
    export.export(
        columns,
        torch.zeros(2, 11),
        path,
        input_name="observation",
        output_names=outputs,
        metadata=metadata,
    )
    observations = random_observations(load_rig("bench"), 10_000, 4)
    assert export.parity(columns, path, observations) <= 1e-6
    answers = OfFile(path)(observations)
    assert np.allclose(answers, OfModule(module)(observations), rtol=1e-5)
    assert (np.ptp(answers, axis=0) > 0.1 * np.ptp(reach, axis=0)).all()
    low, high = reach.astype(np.float32)
    assert ((answers >= low) & (answers <= high)).all()


def test_the_environment_is_judged_by_the_limits_of_the_device() -> None:
    """Film and vibration that count as violated in an episode are those that the device keeps."""
    limits, judged = load_rig("bench").config.limits, EpisodeLimits()
    assert judged.min_film_m == pytest.approx(limits.min_film_um * 1e-6)
    assert judged.swing_share == limits.clearance_share
