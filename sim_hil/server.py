"""The rig in software as a process: real time, one link to the device, one console for people.

It speaks only the wires that a rig of steel would.  Everything is compiled before it says
``ready``.
"""

from __future__ import annotations

import argparse
import math
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from firmware_py import launch
from firmware_py.clock import Clock, MonotonicClock
from firmware_py.config import Config
from firmware_py.launch import Launch
from firmware_py.options import seed
from firmware_py.wire.link import Link, codec_for, open_link
from sim_hil.console import SOCKET_NAME, Console
from sim_hil.plant.drive import HEARTBEAT_LIMIT_DEFAULT_S, HEARTBEAT_LIMIT_S
from sim_hil.rigs import load_rig

if TYPE_CHECKING:
    from sim_hil.hil.rig import Rig
    from sim_hil.plant.duty import Duty

PERIOD_NS = 1_000_000
WARM_UP_STEPS = 1200
"""Simulated milliseconds of a throw-away rig: every message is sent once, everything is
compiled."""


def make_rig(
    config: Config,
    named: str | Path,
    seed: int,
    *,
    nominal: bool = False,
    duty: Duty | None = None,
    fed: bool = False,
    heartbeat_limit_s: float = HEARTBEAT_LIMIT_DEFAULT_S,
) -> Rig:
    """The rig of a name or folder on the wire of ``config``; its build is drawn from ``seed``
    unless ``nominal``."""
    from sim_hil.hil.rig import Rig, node_limits
    from sim_hil.plant.build import Build

    data = load_rig(named)
    build = Build.nominal(data) if nominal else Build.of_seed(data, seed)
    return Rig(
        data, codec_for(config), node_limits(data, config), seed, build=build, duty=duty,
        rate_hz=config.sampling.rate_hz, coast_on_silence=config.drive.coast_down_on_lost_heartbeat,
        fed=fed, heartbeat_limit_s=heartbeat_limit_s,
    )  # fmt: skip


def played(started: Launch) -> str | Path:
    """Which rig the simulator plays: that of the folder, or that which a single file names."""
    folder = started.source.path
    return folder if folder.is_dir() else started.config.device.rig


def warm_up(config: Config, named: str | Path, fed: bool = False) -> None:
    """Compile and run everything once."""
    rig = make_rig(config, named, 0, fed=fed)
    for step in range(WARM_UP_STEPS):
        rig.step(step * PERIOD_NS, [])


def serve(
    rig: Rig, link: Link, console: Console, clock: Clock, running: Callable[[], bool]
) -> None:
    """Read, step, write, sleep on a grid of :data:`PERIOD_NS` while ``running()``; late steps are
    not repeated."""
    due_ns = clock.now_ns()
    while running() and not console.quit:
        now_ns = clock.now_ns()
        for frame in rig.step(now_ns, link.receive(now_ns)):
            link.send(frame)
        console.poll()
        due_ns = max(due_ns + PERIOD_NS, clock.now_ns())
        clock.sleep_until(due_ns)


def main(argv: list[str]) -> int:
    """``orbitd hil``: the rig alone, on the configured bus or serial port."""
    parser = argparse.ArgumentParser(
        prog="orbitd hil",
        description="the rotor rig in software, in real time, on the bus or serial port of the "
        "configuration",
    )
    launch.add_options(parser)
    parser.add_argument(
        "--seed", type=seed, default=1, help="draws build, noise and clock (default 1)"
    )
    parser.add_argument("--nominal", action="store_true", help="the build as drawn, without spread")
    parser.add_argument(
        "--duty", choices=("hold", "published"), default="hold", help="what the drive follows"
    )
    parser.add_argument(
        "--film",
        choices=("periodic", "fed"),
        default="periodic",
        help="unfed film, or fed from the rig's groove, where the supply pressure carries load "
        "(default periodic)",
    )
    parser.add_argument(
        "--heartbeat-limit",
        type=_heartbeat_limit_s,
        default=HEARTBEAT_LIMIT_DEFAULT_S,
        metavar="SECONDS",
        help="the drive coasts down after so long without the device's heartbeat (0.5 to 5, "
        "default 3)",
    )
    options = parser.parse_args(argv)
    from sim_hil.film.domain import describe  # brings the compiler: only when the rig runs
    from sim_hil.plant.duty import Duty

    started = launch.from_options(options)
    named = played(started)
    data = load_rig(named)
    duty = Duty.published(data) if options.duty == "published" else None
    fed = options.film == "fed"
    print("\n".join(describe(data)), flush=True)
    warm_up(started.config, named, fed)
    rig = make_rig(
        started.config,
        named,
        options.seed,
        nominal=options.nominal,
        duty=duty,
        fed=fed,
        heartbeat_limit_s=options.heartbeat_limit,
    )
    _run(started, rig)
    print(
        f"rig ended: {rig.time_s:.1f} s, worst lag {rig.lag_ms_max:.1f} ms, {rig.periods_left_out} "
        f"periods left out"
    )
    return 0


def _heartbeat_limit_s(text: str) -> float:
    """A heartbeat limit as argparse reads it."""
    low_s, high_s = HEARTBEAT_LIMIT_S
    try:
        value_s = float(text)
    except ValueError:
        value_s = math.nan
    if not low_s <= value_s <= high_s:
        raise argparse.ArgumentTypeError(
            f"{text}: not a number of seconds from {low_s:g} to {high_s:g}"
        )
    return value_s


def _run(started: Launch, rig: Rig) -> None:
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda received, _frame: stop.append(received))
    console = Console(started.runtime / SOCKET_NAME, rig)
    link = open_link(started.config, "rig")
    print(f"rig {rig.machine.rig.name} ready on {started.config.bus.link}", flush=True)
    try:
        serve(rig, link, console, MonotonicClock(), lambda: not stop)
    finally:
        link.close()
        console.close()


if __name__ == "__main__":
    import sys

    raise SystemExit(main(sys.argv[1:]))
