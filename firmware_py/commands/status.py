"""``orbitd status``: what the device says of itself, from its gate."""

from __future__ import annotations

import argparse

import msgspec

from firmware_py import launch
from firmware_py.commands import commission
from firmware_py.commands.authority import connect
from firmware_py.commands.models_words import running_words
from firmware_py.gate.view import DeviceState
from firmware_py.records import Alarm, ArmState, GuardState, Mode, Severity

RAD_S_TO_RPM = 9.549296585513721


def main(argv: list[str]) -> int:
    """Print the state once, for a person or as JSON."""
    parser = argparse.ArgumentParser(prog="orbitd status", description=__doc__)
    launch.add_options(parser)
    parser.add_argument("--json", action="store_true", help="the whole state as JSON")
    options = parser.parse_args(argv)
    with connect(options) as client:
        state = client.status()
    print(msgspec.json.encode(state).decode() if options.json else "\n".join(_lines(state)))
    return 0 if state.guard and all(state.rooms.values()) else 1


def _lines(state: DeviceState) -> list[str]:
    rooms = ", ".join(
        f"{process} {'alive' if alive else 'SILENT'}" for process, alive in state.rooms.items()
    )
    lines = [f"{state.site}/{state.rig} ({state.instance}), orbitd {state.version}: {rooms}"]
    if state.guard:
        lines += _guard_lines(state.guard)
    if state.shadow:
        lines.append(
            f"shadow      would say {state.shadow.verdict} "
            f"({100 * state.shadow.probability:.0f} %), {state.shadow.model}"
        )
    if state.diagnosis:
        doubt = ", in doubt" if state.diagnosis.doubt else ""
        sure = f" ({100 * state.diagnosis.probability:.0f} %{doubt})"
        lines.append(
            f"diagnosis   {state.diagnosis.verdict}{sure if state.diagnosis.classes else ''}"
        )
    if state.forecast:
        power, film = state.forecast.power_W[1], state.forecast.min_film_um[1]
        lines.append(
            f"forecast    {power:.0f} W, film {film:.1f} um in {state.forecast.horizon_s:g} s"
        )
    lines += commission.lines(state.commission if state.rooms.get("brain") else None, state.normal)
    if state.models and (state.models.active or state.models.beside is not None):
        lines.append(f"models      {running_words(state.models)}")
    alarms = [_alarm(alarm, state.now_ns) for alarm in state.alarms] or ["none"]
    lines += [f"{'alarms' if number == 0 else '':<12}{text}" for number, text in enumerate(alarms)]
    if state.recording:
        lines.append(f"recording   {state.recording}")
    return lines


def _alarm(alarm: Alarm, now_ns: int) -> str:
    """One standing alarm: severity, name, since when, and its text or its value."""
    since = (
        f"for {max(0.0, (now_ns - alarm.since_ns) * 1e-9):.0f} s"
        if alarm.since_ns
        else "since before the start"
    )
    said = (
        f": {alarm.text}"
        if alarm.text
        else f": {alarm.value:.3g} (limit {alarm.limit:.3g})"
        if alarm.limit
        else ""
    )
    latched = (", latched" if alarm.latched else "") + (", shelved" if alarm.shelved else "")
    return f"{Severity(alarm.severity).name.lower()} {alarm.name} {since}{latched}{said}"


def _guard_lines(guard: GuardState) -> list[str]:
    standing = f"{ArmState(guard.arm_state).name.lower()}, mode {Mode(guard.mode).name.lower()}"
    authority = (
        "model acts"
        if guard.authority
        else f"model does not act: {'; '.join(guard.authority_reasons)}"
    )
    permit = "granted" if guard.run_permit else f"withheld: {'; '.join(guard.permit_reasons)}"
    x_um, y_um = guard.peak_to_peak_um
    others = [
        f"            at {name} {x:.1f} x {y:.1f} um"
        for name, (x, y) in guard.other_peak_to_peak_um.items()
    ]
    lines = [
        f"guard       {standing}; {authority}",
        f"run permit  {permit}",
        *([f"first out   {guard.first_out}"] if guard.first_out else []),
        f"rotor       {guard.speed_rad_s * RAD_S_TO_RPM:.0f} rpm, orbit {x_um:.1f} x {y_um:.1f} um "
        f"peak to peak",
        *others,
    ]
    if guard.monitor_only:
        first, *more = guard.monitor_only.split("; ")
        rest = f" (and {len(more)} more reasons, see `orbitd check`)" if more else ""
        return [f"guard       {standing}, monitor only: {first}{rest}", *lines[1:]]
    return [
        *lines,
        f"clearance   {guard.clearance_actual_um:.1f} um, target {guard.target_clearance_um:.1f} "
        f"um, "
        f"admissible {guard.clearance_low_um:.1f} .. {guard.clearance_high_um:.1f} um (radial)",
    ]
