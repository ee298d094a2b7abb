"""What ``orbitd models`` tells a person: what is in use, and what two sets have said of one
machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from firmware_py.model_sets.shelf import Pointer
from firmware_py.records import ModelsInUse

_SAID = "said:"


class Listing(msgspec.Struct, frozen=True):
    """What ``list`` tells.

    ``running`` is what the device says that runs now, None without one; ``trouble`` what is wrong
    with the shelf.
    """

    directory: str
    shelf: str
    signature_required: bool
    pointer: Pointer
    in_use: list[str]
    refused: dict[str, str]
    sets: list[dict[str, str]]
    running: ModelsInUse | None
    trouble: list[str]


class ForecastErrors(msgspec.Struct, frozen=True):
    """Mean absolute errors of one set's forecasts against what then came; None without any."""

    forecasts: int
    power_W: float | None
    swing_um: float | None


class Compared(msgspec.Struct, frozen=True):
    """What two sets have said of one machine.

    ``disagreements`` count decisions by "what the active said > what the other said";
    ``active_W`` and ``beside_W`` are mean expected powers at both would-be clearances, by the
    active predictor and within the guard's interval.
    """

    active: list[str]
    beside: list[str] | None
    role: str
    decisions: int
    agreement: float | None
    disagreements: dict[str, int]
    advices: int
    active_only: int
    beside_only: int
    apart_um: float | None
    active_W: float | None
    beside_W: float | None
    forecasts: dict[str, ForecastErrors]
    refused: dict[str, int]
    late: dict[str, int]


def compared(
    active: Sequence[str], beside: Sequence[str] | None, role: str, counts: Mapping[str, float]
) -> Compared:
    """The figures in ``counts`` (:mod:`firmware_py.brain.comparison`)."""

    def mean(total: str, of: str) -> float | None:
        number = counts.get(of, 0.0)
        return counts.get(total, 0.0) / number if number else None

    def count(name: str) -> int:
        return round(counts.get(name, 0.0))

    said = {n.removeprefix(_SAID): round(v) for n, v in counts.items() if n.startswith(_SAID)}
    both = ("active", "beside")
    return Compared(
        list(active),
        None if beside is None else list(beside),
        role,
        count("decisions"),
        mean("agreed", "decisions"),
        dict(sorted(said.items(), key=lambda item: -item[1])),
        count("advices"),
        count("active_only"),
        count("beside_only"),
        mean("apart_um", "both"),
        mean("active_W", "priced"),
        mean("beside_W", "priced"),
        {
            name: ForecastErrors(
                count(f"{name}_forecasts"),
                mean(f"{name}_power_W", f"{name}_forecasts"),
                mean(f"{name}_swing_um", f"{name}_forecasts"),
            )
            for name in both
        },
        {name: count(f"{name}_refused") for name in both},
        {name: count(f"{name}_late") for name in both},
    )


def compared_words(c: Compared) -> list[str]:
    """The same as a table."""
    if c.beside is None:
        return ["nothing runs beside; `orbitd models shadow SET` lets a set run along"]
    errors = [c.forecasts["active"], c.forecasts["beside"]]
    rows = [
        ("", "active", f"beside ({c.role})" if c.role else "beside"),
        ("sets", layers(c.active), layers(c.beside)),
        ("forecasts judged", *(str(e.forecasts) for e in errors)),
        ("  error of power, W", *(_number(e.power_W) for e in errors)),
        ("  error of swing, um", *(_number(e.swing_um) for e in errors)),
        ("would-be commands", *(str(c.advices - n) for n in (c.beside_only, c.active_only))),
        ("  expected power, W", _number(c.active_W), _number(c.beside_W)),
        ("answers not finite", *(str(c.refused[name]) for name in ("active", "beside"))),
        ("answers late", *(str(c.late[name]) for name in ("active", "beside"))),
    ]
    wide = [max(len(row[column]) for row in rows) for column in range(3)]
    lines = ["  ".join(f"{v:<{w}}" for v, w in zip(row, wide, strict=True)) for row in rows]
    share = "none" if c.agreement is None else f"{100 * c.agreement:.1f} %"
    lines = [line.rstrip() for line in lines]
    lines.append(f"agreement of {c.decisions} decisions: {share}")
    lines += [f"  {count:6d} x {words}" for words, count in c.disagreements.items()]
    if c.apart_um is not None:
        lines.append(f"would-be clearances {c.apart_um:.2f} um apart in the mean")
    return lines


def list_words(found: Listing) -> list[str]:
    """What is in use and on the shelf."""
    pointer, running = found.pointer, found.running
    required = "required" if found.signature_required else "not required"
    lines = [
        f"models      {found.directory}; signatures {required}",
        f"shelf       {found.shelf}",
        f"in use      generation {pointer.generation}: {layers(pointer.active)}",
        *(f"            {text}" for text in found.in_use),
    ]
    lines += [f"REFUSED     {kind}: {text}" for kind, text in found.refused.items()]
    lines += [f"TROUBLE     {text}" for text in found.trouble]
    if running is None:
        lines.append("device      none runs here: the pointer holds from the next start")
    else:
        lines.append(f"device      uses {running_words(running)}")
    if pointer.former is not None:
        lines.append(f"rollback to {layers(pointer.former)}")
    lines.append(f"in shadow   {pointer.shadow or 'nothing'}")
    if pointer.rolled_back:
        lines.append(f"ROLLED BACK {pointer.rolled_back}")
    lines += [f"on shelf    {s['id']} {s['name']}: {s['files']}" for s in found.sets]
    return lines


def running_words(running: ModelsInUse) -> str:
    """What a running device uses, and what runs beside."""
    beside = "nothing" if running.beside is None else f"{layers(running.beside)} ({running.role})"
    return f"{layers(running.active)}; beside: {beside}"


def layers(names: Sequence[str]) -> str:
    """Sets for people."""
    return " + ".join(["own", *names])


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
