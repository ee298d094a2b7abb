"""Many rotors at once: the interface, the seeds, and the agreement with the whole machine."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from sim_hil import simulate
from sim_hil.gym.control_task import CONTROL_S, OBSERVATIONS, ActionError, Disturbances, actions_of
from sim_hil.gym.environment import ENVIRONMENT_ID, RotorEnv
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.rigs import load_rig

RIG = load_rig("bench")
INDEX = {name: i for i, name in enumerate(OBSERVATIONS)}
GROWING = Disturbances(developing=1.0)


def actions(count: int, value: float) -> NDArray[np.float32]:
    return np.full((count, 1), value, np.float32)


def test_gymnasium_makes_it() -> None:
    envs = gymnasium.make_vec(ENVIRONMENT_ID, num_envs=3, episode_s=0.2)
    assert isinstance(envs.unwrapped, RotorVectorEnv)
    seen, _ = envs.reset(seed=1)
    assert seen in envs.observation_space
    seen, reward, terminated, truncated, infos = envs.step(envs.action_space.sample())
    assert seen in envs.observation_space
    assert reward.shape == terminated.shape == truncated.shape == infos["power_W"].shape == (3,)


def test_a_rotor_is_the_same_whatever_stands_beside_it() -> None:
    def observations(count: int, seed: int) -> NDArray[np.float32]:
        envs = RotorVectorEnv(count, episode_s=0.3)
        seen = [envs.reset(seed=seed)[0]] + [envs.step(actions(count, -0.5))[0] for _ in range(5)]
        return np.stack(seen)

    several = observations(3, seed=4)
    np.testing.assert_array_equal(several, observations(3, seed=4))
    np.testing.assert_array_equal(several[:, 2:], observations(1, seed=6))
    assert not np.array_equal(several[:, 0], several[:, 1])


def test_an_ended_episode_starts_anew_in_the_same_step() -> None:
    envs = RotorVectorEnv(2, episode_s=3 * CONTROL_S)
    envs.reset(seed=0)
    first = list(envs.episodes)
    steps = [envs.step(actions(2, -0.8)) for _ in range(3)]
    assert [step[3].tolist() for step in steps] == [[False] * 2, [False] * 2, [True] * 2]
    assert "final_obs" not in steps[1][4]
    assert not np.array_equal(steps[2][4]["final_obs"], steps[2][0])
    assert all(before != now for before, now in zip(first, envs.episodes, strict=True))


def test_thin_film_trips_one_and_leaves_the_other() -> None:
    thin = replace(Build.nominal(RIG), clearance_error_m=-34e-6)
    envs = RotorVectorEnv(2, duty=Duty.hold(3000, 100), build=Build.nominal(RIG), episode_s=5.0)
    envs.reset(seed=0)
    envs.episodes[1] = replace(envs.episodes[1], build=thin)
    ends = np.array([envs.step(actions(2, -1.0))[2] for _ in range(10)])
    assert not ends[:, 0].any()
    assert ends[:, 1].any()


@pytest.mark.parametrize("seed", [0, 1])
def test_it_agrees_with_the_whole_machine_on_the_same_episode(seed: int) -> None:
    """Mean power within 0.5 %, smallest film within 0.5 um, reading by reading within the noise."""
    steps = 40
    one, many = (
        RotorEnv(episode_s=5.0, disturbances=GROWING),
        RotorVectorEnv(1, episode_s=5.0, disturbances=GROWING),
    )
    one.reset(seed=seed)
    many.reset(seed=seed)
    assert one.episode.duty == many.episodes[0].duty
    single, fleet, seen = [], [], []
    for k in range(steps):
        action = np.array([-0.7 + 0.2 * np.sin(k / 5)], np.float32)
        observation, reward, *_, info = one.step(action)
        others, rewards, _, _, infos = many.step(action[None])
        single.append((info["power_W"], info["min_film_m"], info["peak_to_peak_m"], reward))
        fleet.append(
            (infos["power_W"][0], infos["min_film_m"][0], infos["peak_to_peak_m"][0], rewards[0])
        )
        seen.append(others[0] - observation)
    power, film, swing, reward = (np.array(fleet) - np.array(single)).T
    assert abs(power).max() < 0.005 * np.mean([row[0] for row in single])
    assert abs(film).max() < 0.5e-6
    assert abs(swing).max() < 1.5e-6
    assert abs(reward).max() < 0.01
    apart = np.abs(seen).max(axis=0)
    assert apart[INDEX["eccentricity_x_m"]] < 0.5e-6
    assert apart[INDEX["peak_to_peak_y_m"]] < 2e-6
    assert apart[INDEX["clearance_m"]] < 1.5e-6
    assert apart[INDEX["shaft_power_W"]] < 0.5
    assert apart[INDEX["oil_outlet_C"]] < 0.01
    assert apart[INDEX["subsync_share"]] < 0.01


def test_whirl_shows_in_both() -> None:
    duty, build = Duty.hold(12000, 30), Build.nominal(RIG)
    quiet = Disturbances(developing=0.0)
    envs = RotorVectorEnv(2, duty=duty, build=build, episode_s=10.0, disturbances=quiet)
    envs.reset(seed=3)
    for _ in range(40):
        seen, *_, infos = envs.step(np.array([[-0.8], [-0.4]], np.float32))
    calm, whirling = seen[:, INDEX["subsync_share"]]
    assert calm < 0.1 < 0.5 < whirling
    assert infos["violated"].tolist() == [False, True]


def test_pressure_is_a_second_action_and_its_pump_counts() -> None:
    envs = RotorVectorEnv(1, duty=Duty.hold(6000, 100), build=Build.nominal(RIG), pressure=True)
    assert envs.single_action_space.shape == (2,)
    envs.reset(seed=0)
    for _ in range(20):
        seen, reward, *_, infos = envs.step(np.array([[-0.5, 1.0]], np.float32))
    assert seen[0, INDEX["supply_pressure_bar"]] == pytest.approx(
        RIG.supply.max_Pa * 1e-5, rel=0.01
    )
    assert infos["pump_power_W"][0] > 0.1
    assert infos["power_W"][0] == pytest.approx(
        infos["shaft_power_W"][0] + infos["pump_power_W"][0]
    )
    assert reward[0] < -infos["shaft_power_W"][0] / infos["power_W"][0] * infos["power_share"][0]


@pytest.mark.parametrize("clearance_um", [45.0, 70.0])
def test_a_fed_journal_rests_where_the_fine_steps_of_a_run_put_it(clearance_um: float) -> None:
    """Slow, heavy and narrow, where a coarse step could hang it in mid-air."""
    duty, setting = Duty.hold(2987, 150), (clearance_um * 1e-6, RIG.supply.min_Pa)
    quiet = Disturbances(inlet_C=(RIG.oil.inlet_C, RIG.oil.inlet_C), developing=0.0)
    envs = RotorVectorEnv(4, duty=duty, build=Build.nominal(RIG), pressure=True, disturbances=quiet)
    envs.reset(seed=0)
    for _ in range(15):
        *_, infos = envs.step(actions_of(RIG, np.full((4, 2), setting)))
    fine = simulate(
        RIG, duty, clearance=setting[0], pressure=setting[1], seconds=1.5, fed=True, dt_s=25e-6
    )
    assert infos["min_film_m"] == pytest.approx(fine.min_film_m[-1], rel=0.02)


def test_developing_faults_and_drifting_oil_arrive() -> None:
    envs = RotorVectorEnv(
        6, episode_s=2.0, disturbances=Disturbances(developing=1.0, unbalance_G=(15.0, 16.0))
    )
    envs.reset(seed=0)
    last = np.array([e.unbalance_kg_m.at(2.0) + e.wear_m.at(2.0) for e in envs.episodes])
    assert (last > 0).all()
    assert {e.inlet_at(2.0) for e in envs.episodes} == {e.inlet_C[1] for e in envs.episodes}
    for episode in envs.episodes:
        assert episode.unbalance_kg_m.at(episode.unbalance_kg_m.start_s) == 0.0


def test_an_action_that_is_no_number_is_refused() -> None:
    envs = RotorVectorEnv(1)
    envs.reset(seed=0)
    with pytest.raises(ActionError, match="not finite"):
        envs.step(actions(1, np.nan))
