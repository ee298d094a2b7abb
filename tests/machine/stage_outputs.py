"""What every stage makes of a machine: the outputs that the key matrix compares."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Mapping
from enum import Enum
from functools import cache
from math import pi
from typing import Any, Final

import numpy as np

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.film_check import film_check
from firmware_py.acquire.orders import analyse
from firmware_py.acquire.windows import Window
from firmware_py.brain import made_for
from firmware_py.brain.commissioning import belonging
from firmware_py.brain.core import BrainCore
from firmware_py.brain.measurement import Measured
from firmware_py.brain.prediction import Future, Predictor
from firmware_py.brain.store import Models, load_models
from firmware_py.commands.check import derived, provenance
from firmware_py.config import Config
from firmware_py.guard.core import GuardCore
from firmware_py.guard.envelope.retreat import Ramp
from firmware_py.guard.envelope.shield import Shield
from firmware_py.guard.plausibility.more_readings import MoreReadings
from firmware_py.machine import Machine
from firmware_py.machine.values import Section
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.link import codec_for
from sim_hil.bound.disturbances import RampLimits
from sim_hil.bound.limits import BoundLimits
from sim_hil.film.records import FilmError
from sim_hil.gym.control_task import EpisodeLimits
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.plant.build import Build
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.runs import recording_of
from sim_hil.rigs import RigData
from sim_hil.sensors.chain import SensorChain
from tests.machine.key_changes import base, faults, fed

PROBES: Final = 2
SPEED: Final = 200.0 * pi


def figures(root: object, prefix: str) -> dict[str, list[str]]:
    """All numbers and texts that the objects under ``root`` were made with, by the module of their
    class; tables of the configuration themselves are left out."""
    out: dict[str, list[str]] = defaultdict(list)
    _walk(root, prefix, out, set())
    return out


def _walk(value: object, owner: str, out: dict[str, list[str]], seen: set[int]) -> None:
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | Enum):
        out[owner].append(repr(value))
    elif isinstance(value, np.ndarray):
        out[owner].append(hashlib.sha256(value.tobytes()).hexdigest())
    elif isinstance(value, Section) or id(value) in seen:
        return
    elif isinstance(value, Mapping):
        for name, each in value.items():
            _walk(name, owner, out, seen)
            _walk(each, owner, out, seen)
    elif isinstance(value, list | tuple | set | frozenset):
        for each in value:
            _walk(each, owner, out, seen)
    elif type(value).__module__.startswith("firmware_py."):
        seen.add(id(value))
        names = getattr(value, "__struct_fields__", None) or [
            *getattr(value, "__dict__", ()),
            *(s for kind in type(value).__mro__ for s in getattr(kind, "__slots__", ())),
        ]
        for name in names:
            _walk(getattr(value, name, None), type(value).__module__, out, seen)


@cache
def models() -> Models:
    """Those that ship."""
    return load_models(base(""))


@cache
def counts() -> Any:
    """Half a second of samples of a shaft that runs round, and all else about it."""
    t = np.arange(2500) / 5000.0
    turn = SPEED * t
    probes_m = [6e-6 * np.cos(turn + k) + 8e-6 * (1 - 3 * k) for k in range(PROBES)]
    rest = [np.cos((2 + k) * turn) + 0.1 * np.sin(1234.5 * t + k) for k in range(3)]
    volt = 1.75 + 0.02 * np.cos(turn)
    si = np.column_stack([*probes_m, *rest, 0.1 * np.sin(777.0 * t), np.ones_like(t), volt])
    return np.round(si / np.array([c.wire_scale for c in WireLayout.of(base("")).channels])).astype(
        "<i2"
    )


def of_device(config: Config) -> dict[str, list[object]]:
    """Outputs of check, acquisition, guard and brain."""
    machine, out = config.machine, defaultdict[str, list[object]](list)
    out["check"].append(faults(config))
    layout = WireLayout.of(config)
    out["check"] += [derived(config), provenance(config), layout.text]
    samples = ChannelMap.from_config(config).to_si(counts().copy())
    out["acquire"].append(samples)
    for module, found in figures(GuardCore(config, codec_for(config), 1), "").items():
        stage = "envelope" if ".envelope" in module else "protection"
        stage = "acquire" if ".acquire" in module or ".wire" in module else stage
        out[stage].append((module, found))
    out["protection"].append(figures(MoreReadings(config), ""))
    out["envelope"].append(_intervals(Shield(config)))
    for module, found in figures(BrainCore(config, models()), "").items():
        stage = "diagnosis" if "diagnosis" in module or "normal" in module else "prediction"
        out[stage].append((module, found))
    out["prediction"].append(_forecast(config))
    out["diagnosis"] += [
        _features(samples, machine),
        belonging(models().classifier, config),  # type: ignore[arg-type]
        [made_for.misfit(k, made_for.machines_of(["bench"]), machine) for k in made_for.ALL],
    ]  # fmt: skip
    return out


def _intervals(shield: Shield) -> list[object]:
    ramp = Ramp(1.0, 3.0, 900.0, 200.0)
    points = [(200.0, 200.0, 240.0), (SPEED, 90.0, 110.0), (1200.0, 31.0, 40.0)]
    return [
        shield.interval(speed, low, high, oil_C, swing, 60e-6, ramps)
        for speed, low, high in points
        for oil_C, swing, ramps in ((45.0, 0.0, ()), (52.0, 20e-6, (ramp,)))
    ]


def _forecast(config: Config) -> list[object]:
    predictor = Predictor(models().surrogate, config, models().factors)  # type: ignore[arg-type]
    for i in range(2):
        at = Measured(
            SPEED, 60e-6, 8e-6, -14e-6, 12e-6, 90.0 + i, 45.0 + 0.1 * i, 1.5, 1e-7, i * 10**8
        )
        estimate = predictor.estimate(at)
    predictor.learn(at, 5e-6 + 2e-6j)
    look = predictor.forecast(at, estimate, predictor.candidates_m, Future(2.0, 700.0, 20.0))
    return [look.power_W, look.peak_to_peak_m, look.min_film_m, look.whirl_margin, look.residual_m]


def _features(samples: Any, machine: Machine) -> Any:
    marks = np.arange(0.0, 2500.0, 50.0)
    window = Window(samples, 5000.0, marks, 0, 0, 0, 0, 0xFF, 60e-6, 90.0, 45.0)
    return film_check(window, analyse(window), machine)


def of_rig(config: Config, rig: RigData, key: str) -> dict[str, list[object]]:
    """Outputs of simulator and trainer; a film that is not tabulated is one too."""
    played = [*_played(rig, key), rig.start_rpm, rig.start_load_N]
    trained = [*_trained(rig, fed(key)), BoundLimits.of_rig(rig), RampLimits.of_rig(rig)]
    return {"simulator": played, "trainer": trained}


def _played(rig: RigData, key: str) -> list[object]:
    """A drawn build with moving targets, its pressure above what the pump gives, then lost; and the
    drawing in a film that starves."""
    out: list[object] = []
    extremes = np.array([[-1e3] * 8, [1e3] * 8])
    for build, start_Pa, target_Pa in (
        (Build.of_seed(rig, 1), 8e5, 3e5),
        (Build.nominal(rig), 0.2e5, 0.25e5),
    ):
        try:
            fed = key.startswith("feed.groove")
            out.append(SimulatedMachine(rig, build, 1, fed=fed).readings())
            machine = SimulatedMachine(rig, build, 1, pressure_Pa=start_Pa, fed=fed)
        except FilmError as error:
            return [str(error)]
        drive = np.tile([SPEED, 100.0], (401, 1))
        batches = [
            machine.advance(drive, 70e-6, target_Pa),
            machine.advance(drive[:101], 55e-6, 1e5),
        ]
        machine.inject("pressure_loss", 1.0)
        batches.append(machine.advance(drive[:101], 60e-6, 2e5))
        parts = {
            name: np.concatenate([getattr(b, name) for b in batches])
            for name in ("counts", "truth", "marks")
        }
        recorded = recording_of(machine, Batch(**parts), np.random.default_rng(1))
        chain = SensorChain(rig, build)
        none = np.zeros((2, 8))
        rails = chain.counts(extremes, none, none, none[:, 0], none[:, 0], {})
        out += [*parts.values(), recorded.status, rails, vars(build)]
    return out


def _trained(rig: RigData, fed: bool) -> list[object]:
    try:
        env = RotorVectorEnv(1, rig, episode_s=1.0, pressure=fed)
    except FilmError as error:
        return [str(error)]
    seen, _ = env.reset(seed=1)
    out: list[object] = [seen, env.episodes[0].duty, EpisodeLimits.of_rig(rig)]
    for action in (-0.85, -0.85, 0.9):
        seen, reward, *_, infos = env.step(np.full((1, 1 + fed), action, np.float32))
        out += [seen, reward, sorted(infos.items(), key=lambda item: item[0])]
    return out
