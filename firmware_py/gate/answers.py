"""Answers to questions, each encoded once however often it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from firmware_py.gate import keys
from firmware_py.gate.queries import Question, to_json, to_msgpack

SINCE_DIGITS: Final = 18

Render = Callable[[int], Any]


class Answers:
    """Encodes what is asked for.

    Parameters
    ----------
    fixed
        What never changes while the gate runs, by name.
    live
        What is rendered anew in each step in which it is asked for, by name; called with the time
        of the step.
    events
        The kept events above a sequence number.
    """

    def __init__(
        self, fixed: dict[str, Any], live: dict[str, Render], events: Callable[[int], Any]
    ) -> None:
        self._fixed = fixed
        self._live = live
        self._events = events
        self._kept: dict[tuple[str, bool, int], bytes] = {}
        self._of_step: dict[tuple[str, bool, int], bytes] = {}
        self._step_ns = -1

    def encode(self, name: str, question: Question, now_ns: int) -> bytes:
        """The answer to ``question`` about ``name``."""
        if now_ns != self._step_ns:
            self._of_step, self._step_ns = {}, now_ns
        kept = self._kept if name in self._fixed else self._of_step
        after = since(question.parameters.get("since", "")) if name == keys.EVENTS else -1
        place = (name, question.packed, after)
        if place not in kept:
            kept[place] = (to_msgpack if question.packed else to_json)(
                self._value(name, after, now_ns)
            )
        return kept[place]

    def _value(self, name: str, after: int, now_ns: int) -> Any:
        if name in self._fixed:
            return self._fixed[name]
        return self._events(after) if name == keys.EVENTS else self._live[name](now_ns)


def since(text: str) -> int:
    """The sequence number in the parameter ``since``; -1 (all events) for what is none."""
    digits = text.removeprefix("-")
    if not digits.isascii() or not digits.isdigit() or len(digits) > SINCE_DIGITS:
        return -1
    return int(text)
