"""Trainer of the clearance agent: DDPG over several seeds behind the guard's shield, beside what could replace it."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models import card, export, figures
from models.control import judge as actor_judge
from models.control.episodes import Fixed, Policy, Score, play, play_machine
from models.control.judge import Bench
from models.control.rivals import AdaptivePI, EccentricityPI, lookup
from models.control.shielded import Observation, ShieldedRotors
from models.learning.ddpg import Actor, DdpgSettings, Scale, train_ddpg
from models.learning.dqn import Values, actions_of_choices, train_dqn
from models.runs import Run, Settings, progress_bar
from sim_hil.control_task import OBSERVATIONS
from sim_hil.rigs import RigData, load_rig
from sim_hil.vector_environment import RotorVectorEnv

JUDGE_SEED, VALIDATION_SEED = 1_001_000, 500_000
"""Added to the seed of judged episodes, and of those that choose among the agents, so that no training sees them."""

PI = (0.45, 40e-6, 60e-6)
"""Set point of the eccentricity ratio, gain and integral gain of both controllers."""

RANGES = {
    "speed_rad_s": (100.0, 1400.0),
    "eccentricity_x_m": (-1.2e-4, 1.2e-4),
    "eccentricity_y_m": (-1.2e-4, 1.2e-4),
    "peak_to_peak_x_m": (0.0, 1e-4),
    "peak_to_peak_y_m": (0.0, 1e-4),
    "clearance_m": (3e-5, 1.7e-4),
    "supply_pressure_bar": (0.0, 4.0),
    "shaft_power_W": (-10.0, 500.0),
    "oil_outlet_C": (20.0, 80.0),
    "load_estimate_N": (0.0, 500.0),
    "subsync_share": (0.0, 1.0),
}
"""What a working machine shows: the scale of the network's inputs, and the model's domain."""


class ActorSettings(Settings, frozen=True):
    """What ``orbitd train actor`` does; every key may stand in the ``--config`` file."""

    rig: str = "bench"
    seeds: int = 10
    rotors: int = 16
    episode_s: float = 15.0
    ddpg: DdpgSettings = DdpgSettings()
    dqn_choices: int = 13
    lookup_points: tuple[int, int, int] = (7, 6, 25)
    validation_episodes: int = 16
    judged_episodes: int = 50
    judged_seconds: float = 20.0
    machine_episodes: int = 10
    workers: int = 2

    def smoked(self) -> ActorSettings:
        """The same training in some seconds."""
        return ActorSettings(
            seeds=2, rotors=4, episode_s=2.0, ddpg=DdpgSettings(steps=240, warm_up=80, batch=32, hidden=(16, 16)),
            lookup_points=(2, 2, 3), validation_episodes=2, judged_episodes=2, judged_seconds=1.0, machine_episodes=1,
            workers=1,
        )  # fmt: skip


SETTINGS = ActorSettings


class Clearance(nn.Module):
    """``observation (m, 11)`` in SI -> ``clearance (m, 1)`` in metres, inside the bearing's range."""

    def __init__(self, actor: Actor, low_m: float, high_m: float) -> None:
        super().__init__()
        self.actor, self.low_m, self.high_m = actor, low_m, high_m

    def forward(self, observation: Tensor) -> Tensor:
        """Scaled and clipped inside the graph."""
        share = 0.5 * (self.actor(observation) + 1.0)
        return torch.clamp(self.low_m + share * (self.high_m - self.low_m), self.low_m, self.high_m)


class Chosen:
    """A policy without memory: a function of the observations ``(m, 11)`` to clearances ``(m,)``."""

    def __init__(self, choose: Callable[[Observation], NDArray[np.float64]]) -> None:
        self._choose = choose

    def start(self, count: int) -> None:
        """Nothing to forget."""

    def __call__(self, observation: Observation) -> NDArray[np.float64]:
        """As :class:`models.control.episodes.Policy`."""
        return self._choose(observation)


def of_module(module: nn.Module) -> Policy:
    """A torch module as a policy."""

    def choose(observation: Observation) -> NDArray[np.float64]:
        with torch.no_grad():
            return np.asarray(module(torch.from_numpy(observation))[:, 0].numpy(), np.float64)

    return Chosen(choose)


def of_file(path: Path) -> Policy:
    """An exported file as a policy."""
    session = export.session(path)
    return Chosen(lambda observation: np.asarray(
        session.run(["clearance"], {"observation": observation})[0][:, 0], np.float64))  # fmt: skip


def of_values(values: Values, rig: RigData) -> Policy:
    """The choices of highest value as a policy."""
    low, high = rig.bearing.clearance_min_m, rig.bearing.clearance_max_m
    row = low + 0.5 * (actions_of_choices(values.choices).astype(np.float64) + 1.0) * (high - low)
    return Chosen(lambda observation: row[values.best(observation)])


def learn(settings: ActorSettings, seed: int, on_step: Callable[[int], None] | None = None,
          on_episode: Callable[[int, float], None] | None = None) -> Clearance:  # fmt: skip
    """One DDPG agent, trained behind the shield."""
    torch.set_num_threads(1)
    bearing = load_rig(settings.rig).bearing
    actor = train_ddpg(_environment(settings), _scale(), settings.ddpg, seed, on_step, on_episode)
    return Clearance(actor, bearing.clearance_min_m, bearing.clearance_max_m)


def _environment(settings: ActorSettings) -> ShieldedRotors:
    return ShieldedRotors(RotorVectorEnv(settings.rotors, settings.rig, settings.episode_s))


def _scale() -> Scale:
    low, high = np.array([RANGES[name] for name in OBSERVATIONS], np.float32).T
    return Scale(low, high)


def train(run: Run, settings: ActorSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model.

    The agent of the seed that did best on validation episodes stands for DDPG.  It ships as the actor if it needs
    less power than the lookup table at no more violation; otherwise the table does, and DDPG stands beside it.
    """
    started = time.monotonic()
    rig = load_rig(settings.rig)
    agents = _learn_all(run, settings)
    with progress_bar("DQN", settings.ddpg.steps) as bar:
        values = train_dqn(_environment(settings), _scale(), settings.ddpg, settings.dqn_choices, run.seed, bar)
    with progress_bar("lookup table", settings.lookup_points[0]) as bar:
        table = lookup(rig, settings.lookup_points, bar)
    chosen = _choose(agents, settings, run.seed)
    trained_s = round(time.monotonic() - started, 1)
    bench = _bench(settings, run.seed, run.folder.parent)
    scores = [bench.play(of_module(agent), shielded=True) for agent in agents]
    rivals = {**_rivals(rig, of_module(table)), "dqn": of_values(values, rig)}
    report = judge(bench, {"ddpg": of_module(agents[chosen]), **rivals}, scores)
    shipped = "ddpg" if actor_judge.beats(report["ddpg_less_lookup"]) else "lookup"
    policies = {"ddpg": agents[chosen], "lookup": table}
    report |= {
        "whole_machine": _on_machine({"shipped": of_module(policies[shipped]), **_rivals(rig, of_module(table))},
                                     settings, run.seed),
        "shipped": shipped, "ddpg_seed": chosen, "reproduce": run.command,
        "training": {"steps": settings.ddpg.steps, "agents": len(agents), "seconds": trained_s},
    }  # fmt: skip
    _export(agents[chosen], run.folder / "actor_ddpg.onnx", "ddpg", run, settings, report)
    report["export_parity"] = _export(policies[shipped], run.model, shipped, run, settings, report)
    run.write_json("actor.json", report)
    card.write(run, report, card.ACTOR)
    figures.actor(run.folder, report)
    return report


def evaluate(path: Path, seed: int, size: int | None, out: Path) -> dict[str, object]:
    """The policy in ``path`` beside its rivals on the episodes of ``seed``."""
    settings = ActorSettings(judged_episodes=size or ActorSettings().judged_episodes)
    rig = load_rig(settings.rig)
    with progress_bar("lookup table", settings.lookup_points[0]) as bar:
        table = lookup(rig, settings.lookup_points, bar)
    policies = {"agent": of_file(path), **_rivals(rig, of_module(table))}
    beside = path.with_name("actor_ddpg.onnx")
    if beside.is_file():
        policies["ddpg"] = of_file(beside)
    return {
        "unseen_episodes": judge(_bench(settings, seed, out), policies, []),
        "whole_machine": _on_machine(policies, settings, seed),
    }  # fmt: skip


def judge(bench: Bench, policies: dict[str, Policy], scores: list[Score]) -> dict[str, Any]:
    """Figures of each policy behind the shield, of the first and the table without it, and of all agents together."""
    rows, behind = {}, {}
    first = next(iter(policies))
    with progress_bar("unseen episodes", len(policies)) as bar:
        for done, (name, policy) in enumerate(policies.items(), 1):
            behind[name] = bench.play(policy, shielded=True)
            rows[name] = bench.figures(behind[name])
            bar(done)
    for name in (first, "lookup"):
        rows[f"{name}_without_shield"] = bench.figures(bench.play(policies[name], shielded=False))
    nominal_um = 1e6 * load_rig(bench.rig).bearing.clearance_nominal_m
    rows[f"fixed_{nominal_um:g}_um"] = bench.figures(bench.play(Fixed(nominal_um * 1e-6), shielded=False))
    report: dict[str, Any] = {**bench.header(), "policies": rows}
    if scores:
        report["ddpg_all_seeds"] = bench.over_seeds(scores)
    for name in policies:
        if name != first:
            report[f"{first}_less_{name}"] = bench.paired(behind[first], behind[name])
    return report


def _rivals(rig: RigData, table: Policy) -> dict[str, Policy]:
    """What needs no training; ``widest`` wishes for the largest clearance always, and shows what the shield gives."""
    b = rig.bearing
    reach = (b.clearance_min_m, b.clearance_max_m)
    return {
        "lookup": table, "pi": EccentricityPI(*PI, reach), "adaptive_pi": AdaptivePI(*PI, reach),
        "widest": Fixed(b.clearance_max_m),
    }  # fmt: skip


def _bench(settings: ActorSettings, seed: int, out: Path) -> Bench:
    seeds = _judged_seeds(settings.judged_episodes, seed)
    return Bench.of(seeds, settings.judged_seconds, settings.rig, out, settings.workers)


def _judged_seeds(count: int, seed: int) -> range:
    return range(JUDGE_SEED + 1000 * seed, JUDGE_SEED + 1000 * seed + count)


def _on_machine(policies: dict[str, Policy], settings: ActorSettings, seed: int) -> dict[str, dict[str, float]]:
    """The same episodes on the whole machine with its sensors, behind the shield."""
    seeds = _judged_seeds(settings.machine_episodes, seed)
    rows = {}
    with progress_bar("whole machine", len(policies)) as bar:
        for done, (name, policy) in enumerate(policies.items(), 1):
            score = play_machine(policy, seeds, settings.judged_seconds, rig=settings.rig)
            rows[name] = score.summary(settings.judged_seconds)
            bar(done)
    return rows


def _learn_all(run: Run, settings: ActorSettings) -> list[Clearance]:
    agents = []
    with progress_bar("DDPG", settings.seeds * settings.ddpg.steps) as bar:
        for number in range(settings.seeds):

            def on_step(step: int, number: int = number) -> None:
                bar(number * settings.ddpg.steps + step)

            def on_episode(step: int, total: float, number: int = number) -> None:
                run.log({"agent": number, "step": step, "return": round(total, 3)})

            one = partial(learn, settings, 1000 * run.seed + number, on_step, on_episode)
            agents.append(run.kept(f"agent{number}", one))
            torch.save(agents[-1].state_dict(), run.folder / f"agent{number}.pt")
    return agents


def _choose(agents: list[Clearance], settings: ActorSettings, seed: int) -> int:
    """Number of the agent with least violation, then least power, on validation episodes."""
    seeds = range(VALIDATION_SEED + 1000 * seed, VALIDATION_SEED + 1000 * seed + settings.validation_episodes)
    scores = [play(of_module(a), seeds, settings.judged_seconds, shielded=True, rig=settings.rig) for a in agents]
    return min(range(len(agents)), key=lambda i: (float(scores[i].violation_s.sum()), float(scores[i].power_W.mean())))


def _export(
    module: nn.Module, path: Path, policy: str, run: Run, settings: ActorSettings, report: dict[str, Any]
) -> float:
    """Write one file; returns how far it is from the module."""
    names = tuple(OBSERVATIONS)
    metadata = export.Metadata(
        kind="actor", version="0.2.0", inputs=names, outputs=("clearance",), rate_hz=(10,), channels=(),
        units=("rad/s", "m", "m", "m", "m", "m", "bar", "W", "degC", "N", "1", "-> m"), rigs=(settings.rig,),
        domain={name: RANGES[name] for name in names}, data_hash=export.data_hash(np.array([run.seed])),
        settings={"policy": policy}, metrics={"policies": report["policies"], "reproduce": run.command},
    )  # fmt: skip
    example = torch.zeros(2, len(names))
    export.export(module, example, path, input_name="observation", output_names=("clearance",), metadata=metadata)
    return export.parity(module, path, random_observations(10_000, run.seed))


def random_observations(count: int, seed: int) -> NDArray[np.float32]:
    """Observations over the ranges and beyond, corners first."""
    low, high = np.array(list(RANGES.values())).T
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, 2, (min(count, 2 ** min(len(low), 10)), len(low)))
    spread = rng.uniform(-0.5, 1.5, (count - len(corners), len(low)))
    share = np.concatenate([corners.astype(np.float64), spread])
    return np.asarray(low + share * (high - low), np.float32)
