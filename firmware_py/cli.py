"""The ``orbitd`` command: finds its subcommands, runs one, turns every refusal into one line.

Exit codes: 0 done; 1 refused, failed or not ok; 2 wrong input (usage, configuration, file);
3 the device or a process of it does not answer; 130 interrupted.
"""

from __future__ import annotations

import gc
import importlib.metadata
import io
import os
import sys
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path

from firmware_py import __version__, background
from firmware_py.errors import OrbitdError

Command = Callable[[list[str]], int]

GROUP = "orbitd.commands"
BACKGROUND = ("brain", "gate")
"""What starts in the background, for the guard may be protecting already."""
ROOT = Path(__file__).parents[1]

SUMMARIES = (
    ("demo", "the whole device against the rotor rig in software, as a story"),
    ("run", "guard, brain and gate together, supervised (without systemd)"),
    ("guard", "the guard alone: bus, protection, shield, arming"),
    ("brain", "the brain alone: diagnosis, prediction, policy"),
    ("gate", "the gate alone: Zenoh, recorder, metrics, page, commands"),
    ("hil", "the rig alone, in real time, on a bus or a serial port"),
    ("bus", "watch what crosses the bus, decoded"),
    ("rig", "make a rig folder, show what follows from one, the DBC of its bus"),
    ("check", "check a rig folder, as the device would at start"),
    ("protection", "causes and effects of protection, from the configuration"),
    ("migrate", "make a rig folder of a configuration file of the first schema"),
    ("status", "what the device says of itself"),
    ("mode", "monitor, manual or auto"),
    ("arm", "allow the device to move the actuator"),
    ("disarm", "take that back; never refused"),
    ("reset", "clear a latched trip"),
    ("set", "set clearance or pressure by hand (mode manual)"),
    ("announce", "tell a faster ramp of speed or load ahead of time"),
    ("commission", "teach the device what is normal for this machine"),
    ("models", "which models are in use; another set in shadow, promoted, rolled back"),
    ("keys", "keys that sign sets of models, and those that the device trusts"),
    ("inject", "give the rig in software a fault or another operating point"),
    ("verify", "the film and rotor against closed forms and published tables"),
    ("bench", "speed of the simulator against a reference kernel"),
    ("plot", "orbit, pressure, waterfall, map, Campbell diagram, duty as figures"),
    ("bound", "how much power any control could save on a duty"),
    ("replay", "run a recording again and compare every decision"),
    ("install", "install or remove the systemd units"),
    ("build", "make the models of a machine from its rig folder (extra `train`)"),
    ("dataset", "what is read of a folder of recordings, and what is wrong (extra `train`)"),
    ("train", "train a model (extra `train`)"),
    ("evaluate", "judge a model on builds and duties drawn from a seed (extra `train`)"),
    ("reproduce", "the paper's three series of tests again, as a report (extra `train`)"),
)


PROCESSES = ("run", "guard", "brain", "gate")
"""Commands that run for ever: an error of the system ends them with 1, so that they are started
again."""

EXTRA_OF = {
    "gymnasium": "sim",
    "numba": "sim",
    "scipy": "sim",
    "distributed": "spread",
    "matplotlib": "train",
    "onnx": "train",
    "sklearn": "train",
    "skl2onnx": "train",
    "tensorboard": "train",
    "torch": "train",
}
"""Extra that brings a package."""


def main(argv: list[str] | None = None) -> int:
    """Run ``orbitd ARGV`` and return its exit code; a reader that has seen enough ends it
    quietly."""
    _open_streams()
    try:
        code = _main(sys.argv[1:] if argv is None else argv)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        _drop_output()
        return 0
    except KeyboardInterrupt:
        return 130
    except OSError as error:  # the flush: a full disk behind standard output
        _drop_output()
        return _fail(f"standard output: {error.strerror or error}", 1)


def _open_streams() -> None:
    """Closed standard streams become nothing; what a stream cannot encode is replaced."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _drop_output() -> None:
    """Nothing more can be said: what still waits must not fail again at the end."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):  # no file behind it
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def _main(arguments: list[str]) -> int:
    entry_points = {point.name: point for point in importlib.metadata.entry_points(group=GROUP)}
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(_help(entry_points))
        return 0 if arguments else 2
    if arguments[0] == "--version":
        print(f"orbitd {__version__}")
        return 0
    point = entry_points.get(arguments[0])
    if point is None:
        return _fail(f"no command {arguments[0]!r}; `orbitd --help` lists them", 2)
    return _run(point, arguments[1:])


def _run(point: importlib.metadata.EntryPoint, arguments: list[str]) -> int:
    """Load and run one subcommand; every expected refusal becomes one line and an exit code."""
    if point.name in BACKGROUND:
        background.lower()
    elif point.name == "guard":
        gc.disable()  # its loop runs without; its imports take a tenth less time so
    try:
        command: Command = point.load()
        return command(arguments)
    except SystemExit as ended:  # of argparse, after its help or one line of refusal
        return (
            ended.code
            if isinstance(ended.code, int)
            else 0
            if ended.code is None
            else _fail(str(ended.code), 1)
        )
    except ModuleNotFoundError as error:
        return _fail(
            f"`orbitd {point.name}` needs {error.name}, which is not installed; "
            f"{_extra(point, error)}",
            2,
        )
    except OrbitdError as error:
        return _fail(str(error), error.exit_code)
    except BrokenPipeError:
        raise
    except (
        OSError
    ) as error:  # a file that a person named, a full disk: the system says what is wrong
        return _fail_of_system(point.name, error)
    finally:  # whoever calls this in a process of its own choosing gets it back as it was
        background.restore()
        gc.enable()


def _fail_of_system(name: str, error: OSError) -> int:
    """One line with cause, file and place in the program."""
    frames = traceback.extract_tb(error.__traceback__)
    frame = next(
        (each for each in reversed(frames) if Path(each.filename).is_relative_to(ROOT)), frames[-1]
    )
    cause = ": ".join(str(part) for part in (error.filename, error.strerror or error) if part)
    code = 2 if error.filename is not None and name not in PROCESSES else 1
    return _fail(f"{name}: {cause} ({Path(frame.filename).name}:{frame.lineno})", code)


def _extra(point: importlib.metadata.EntryPoint, error: ModuleNotFoundError) -> str:
    """Which extra brings what ``point`` misses."""
    missing = (error.name or "").partition(".")[0]
    extra = EXTRA_OF.get(missing)
    if point.module.partition(".")[0] == "models" and extra != "spread":
        extra = "train"
    if missing in ("firmware_py", "sim_hil", "models") or extra is None:
        return "install orbitd again"
    return f"install the extra: pip install 'orbitd[{extra}]'"


def _fail(text: str, code: int) -> int:
    print(f"orbitd: {text}", file=sys.stderr)
    return code


def _help(names: Iterable[str]) -> str:
    known = dict(SUMMARIES)
    order = [*known, *sorted(set(names) - set(known))]
    lines = [f"  {name:<12}{known.get(name, '')}".rstrip() for name in order if name in set(names)]
    return "\n".join(
        (
            "usage: orbitd COMMAND [OPTION ...]",
            "",
            "Simulates, diagnoses, predicts and controls a rotor on a fluid-film bearing.",
            "",
            *lines,
            "",
            "`orbitd COMMAND --help` tells the options.",
            "Exit codes: 0 done, 1 refused or not ok, 2 wrong input, 3 the device does not answer.",
        )
    )
