"""The demo on a terminal: one table that a person can follow, and the lines of the story under
it."""

from __future__ import annotations

from collections import deque

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from firmware_py.records import ArmState, Mode
from sim_hil.demo.observer import StoryObserver
from sim_hil.demo.story import Beat, Story

RAD_S_TO_RPM = 9.549296585513721
LINES = 8


class Quiet:
    """No display: programs read the JSON."""

    def say(self, text: str, style: str = "") -> None:
        """Nothing."""

    def update(self, t_s: float) -> None:
        """Nothing."""

    def __enter__(self) -> Quiet:
        return self

    def __exit__(self, *raised: object) -> None:
        return None


class Screen(Quiet):
    """The live table; on a pipe it prints the story's lines only."""

    def __init__(self, story: Story, observer: StoryObserver, console: Console) -> None:
        self._story, self._observer, self._console = story, observer, console
        self._lines: deque[Text] = deque(maxlen=LINES)
        self._live = Live(
            console=console, refresh_per_second=4, transient=False, auto_refresh=False
        )
        self._act = ""
        self._next_s = 0.0

    def __enter__(self) -> Screen:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *raised: object) -> None:
        self._live.stop()

    def say(self, text: str, style: str = "") -> None:
        """One line of the story."""
        line = Text(text, style=style)
        self._lines.append(line)
        if not self._console.is_terminal:
            self._console.print(line)

    def update(self, t_s: float) -> None:
        """Redraw four times a second; announce each new act."""
        act = self._story.act_at(t_s)
        if f"{act.name}{act.start_s}" != self._act:
            self._act = f"{act.name}{act.start_s}"
            self.say(f"{t_s:6.1f} s  ── {act.text}", "bold")
        if self._console.is_terminal and t_s >= self._next_s:
            self._next_s = t_s + 0.25
            self._live.update(self._render(t_s), refresh=True)

    def _render(self, t_s: float) -> Panel:
        bar = Table.grid()  # a bar alone does not end its line
        bar.add_row(
            ProgressBar(
                total=self._story.seconds, completed=t_s, width=min(60, self._console.width - 6)
            )
        )
        body = Group(bar, _table(self._observer), *self._lines)
        return Panel(
            body,
            title=f"orbitd demo, seed {self._story.seed}, {t_s:.0f} of {self._story.seconds:.0f} s",
        )


def beat_text(beat: Beat) -> str:
    """What a beat does, in plain words, for the person (the device is not told)."""
    match beat.verb:
        case "operating":
            return (
                f"the drive goes to {beat.speed_rpm:.0f} rpm, the load to {beat.load_N:.0f} N in "
                f"{beat.ramp_s:.1f} s"
            )
        case "inject":
            unit = "G" if beat.fault == "unbalance" else "% preload left"
            return f"injected, unknown to the device: {beat.fault} ({beat.severity:g} {unit})"
        case "clear":
            return f"mended: {beat.fault}"
        case "arm":
            return "a person arms the device and chooses mode auto"
        case "kill_brain":
            return "the brain's process is killed"


def _table(observer: StoryObserver) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, value in (*_machine(observer), *_device(observer)):
        table.add_row(Text(name, style="dim"), value)
    return table


def _machine(observer: StoryObserver) -> list[tuple[str, str]]:
    if not observer.truth:
        return [("rig", "starting")]
    truth = observer.truth[-1]
    return [
        ("rig", f"{truth.speed_rad_s * RAD_S_TO_RPM:6.0f} rpm   {truth.load_N:4.0f} N"),
        (
            "film",
            f"{truth.min_film_um:5.1f} um at least   orbit {truth.peak_to_peak_um:5.1f} um peak to "
            f"peak",
        ),
        ("power", f"{truth.power_W:6.1f} W"),
    ]


def _device(observer: StoryObserver) -> list[tuple[str, str]]:
    rows = []
    if state := observer.state:
        authority = (
            "the model acts"
            if state.authority
            else "safe value: " + ", ".join(state.authority_reasons[:2])
        )
        standing = f"{ArmState(state.arm_state).name.lower()}, {Mode(state.mode).name.lower()}"
        rows.append(("guard", f"{standing}; {authority}"))
        admissible = f"admissible {state.clearance_low_um:.0f} .. {state.clearance_high_um:.0f}"
        rows.append(("clearance", f"{state.clearance_actual_um:5.1f} um   {admissible}"))
        rows.append(("alarms", ", ".join(alarm.name for alarm in state.alarms) or "none"))
    if diagnosis := observer.diagnosis:
        doubt = " (in doubt)" if diagnosis.doubt else ""
        rows.append(
            ("diagnosis", f"{diagnosis.verdict} {100 * diagnosis.probability:.0f} %{doubt}")
        )
    if forecast := observer.forecast:
        rows.append(
            (
                f"in {forecast.horizon_s:.0f} s",
                f"{forecast.power_W[1]:.0f} W ({forecast.power_W[0]:.0f} .. "
                f"{forecast.power_W[2]:.0f})   "
                f"orbit {forecast.peak_to_peak_um[1]:.1f} um   film "
                f"{forecast.min_film_um[1]:.1f} um",
            )
        )
    return rows
