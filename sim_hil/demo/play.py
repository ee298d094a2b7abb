"""One demo from its options to its result: on the simulated clock, or as processes in real time."""

from __future__ import annotations

import argparse
import json
import math
import shutil
import time
from typing import Any

from rich.console import Console

from firmware_py.brain.store import load_models
from firmware_py.config import Config
from firmware_py.machine.parts import monitor_only
from sim_hil.demo import latency, live_run, simulated
from sim_hil.demo.counterfactual import rerun_fixed
from sim_hil.demo.host import HostProbe, HostTiming
from sim_hil.demo.live import Quiet, Screen
from sim_hil.demo.observer import StoryObserver
from sim_hil.demo.recording import recorded
from sim_hil.demo.report import (
    CLASSIFIER,
    COMMAND,
    BusCount,
    LoopTiming,
    Outcome,
    as_dict,
    summary,
)
from sim_hil.demo.scores import KillScore, score_faults, score_film, score_forecasts, score_kill
from sim_hil.demo.setting import Setting, prepare
from sim_hil.demo.story import Story, draw

SETTLED_S = 1.0
"""Film is judged from here on: before it the rig runs up."""

LATENCY_FROM_S = 60.0
LATENCY_TRIALS = 20
"""Reaction trials after a story of at least this length."""


def play(options: argparse.Namespace) -> int:
    """Play one demo; exit code 0 when every term of ``ok`` holds, 1 when not."""
    began_s = time.monotonic()
    setting = prepare(options.rig, options.seed).on(link=options.link, **_port(options.link))
    story = draw(options.seconds, options.seed, setting.config.machine.operating, options.fault)
    console = Console(stderr=options.json)
    observer = StoryObserver(simulated.START_NS)
    screen = Quiet() if options.json else Screen(story, observer, console)
    play = _play_simulated if options.clock == "sim" else _play_live
    outcome = play(setting, story, observer, screen, options, began_s)
    result = as_dict(outcome)
    print(json.dumps(result) if options.json else "\n".join(["", *summary(result)]))
    return 0 if result["ok"] else 1


def _port(link: str) -> dict[str, Any]:
    """A serial setting needs a port's name; the cable's own replaces it when it is laid."""
    return {"serial_port": "cable"} if link == "serial" else {}


def _play_simulated(
    setting: Setting,
    story: Story,
    observer: StoryObserver,
    screen: Quiet,
    options: argparse.Namespace,
    began_s: float,
) -> Outcome:
    with recorded(options.record, setting.config) as listeners:
        run = simulated.Player(setting, story, screen, observer, listeners).play()
    counters = run.counters
    bus = BusCount(
        "simulated",
        run.frames_expected,
        counters["frames_in"],
        counters["frames_lost"],
        counters["blocks_lost"],
    )
    loop = LoopTiming(1000.0, 0.0, {"p50": 0.0, "p99": 0.0})
    no_latency: dict[str, Any] = {"exceedance_to_safe": None, "echo": None}
    return _outcome(
        setting, story, observer, bus, HostTiming(0, 0.0), 0.0, loop, no_latency, run.brain_back_s
    )


def _play_live(
    setting: Setting,
    story: Story,
    observer: StoryObserver,
    screen: Quiet,
    options: argparse.Namespace,
    began_s: float,
) -> Outcome:
    with live_run.open_stage(setting, story.seed) as stage:
        screen.say("starting rig, guard, brain and gate")
        host = HostProbe()
        run = live_run.play(stage, story, screen, observer, began_s)
        timing = host.stop()
        screen.say(f"first samples through the device {run.first_command_s:.1f} s after the start")
        stage.stop()
        if options.record:
            shutil.copyfile(run.recording, options.record)
    if story.seconds >= LATENCY_FROM_S:
        screen.say(f"measuring the guard's reaction to danger: {LATENCY_TRIALS} trials")
        reaction = latency.measure(setting, LATENCY_TRIALS)
    else:
        reaction = {"exceedance_to_safe": None, "echo": None}
    counters = run.counters
    bus = BusCount(
        f"{setting.config.bus.link} {setting.config.bus.interface}"
        if options.link == "can"
        else "serial pty",
        counters["frames_in"] + counters["frames_lost"],
        counters["frames_in"],
        counters["frames_lost"],
        counters["blocks_lost"],
    )
    cycles = max(1, counters["cycles"])
    loop = LoopTiming(
        1000.0,
        round(counters["cycles_late"] / cycles, 5),
        {
            "p50": counters["lateness_p50_us"] * 1e-3,
            "p99": counters["lateness_p99_us"] * 1e-3,
        },
    )
    return _outcome(
        setting, story, observer, bus, timing, run.lag_ms_max, loop, reaction, run.brain_back_s
    )


def _outcome(
    setting: Setting,
    story: Story,
    observer: StoryObserver,
    bus: BusCount,
    host: HostTiming,
    lag_ms: float,
    loop: LoopTiming,
    reaction: dict[str, Any],
    brain_back_s: float | None,
) -> Outcome:
    """Score what was observed."""
    duty_act = next(act for act in story.acts if act.name == "duty")
    duty_truth = [
        truth for truth in observer.truth if duty_act.start_s <= truth.t_s < duty_act.end_s
    ]
    killed = any(beat.verb == "kill_brain" for _, beat in observer.beats)
    config = setting.config
    slowest_rad_s = 0.98 * config.machine.operating.speed_min_rpm * math.pi / 30
    safe_um = config.machine.actuator.safe_radial_clearance_um
    kills: list[KillScore] = [score_kill(observer, safe_um, brain_back_s)] if killed else []
    return Outcome(
        story,
        observer,
        duty_truth,
        bus,
        host,
        lag_ms,
        loop,
        reaction,
        score_faults(observer),
        score_forecasts(observer),
        score_film(observer, config.limits.min_film_um, SETTLED_S, slowest_rad_s),
        kills,
        rerun_fixed(duty_truth, setting, story.seed),
        lacking(config),
    )


def lacking(config: Config) -> dict[str, str]:
    """What the device lacks on this machine: nothing is commanded where it is monitor only, no
    fault is named without a classifier made for it."""
    found = {}
    if why := monitor_only(config.machine):
        found[COMMAND] = f"monitor only: {why[0]}"
    models = load_models(config)
    if models.classifier is None:
        why_not = models.refusals.get("classifier") or models.off.get("classifier", "none")
        found[CLASSIFIER] = f"no classifier for this machine: {why_not}"
    return found
