"""What a command's payload must look like: ``{"id": "...", "value": ...}``, and what its value may
be."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, Literal

import msgspec

from firmware_py.decoding import SAID_LETTERS, OutsideError, from_json
from firmware_py.records import (
    BRAIN_VERBS,
    COMMISSION_ACTIONS,
    MODELS_ACTIONS,
    REQUEST_ID,
    VERBS,
    CommandRequest,
    Mode,
    PlannedRamp,
)

PAYLOAD_LIMIT_BYTES: Final = 4096
"""The largest sensible command, an announced ramp, has some 150."""

UNITS: Final = {"set_clearance": "um, radial", "set_pressure": "bar"}

_EXAMPLES: Final = {
    "mode": '"auto"',
    "set_clearance": "60.0",
    "set_pressure": "1.5",
    "commission": '"start"',
    "bypass": '{"target": "disp_x", "seconds": 600, "owner": "A. Person", "reason": "new probe"}',
    "shelve": '{"target": "disp_x_alert", "seconds": 600}',
    "models": '{"action": "shadow", "set": "05d51b3fe524b60d"}',
    "announce": '{"start_s": 3, "end_s": 5, "speed_rpm": 9000, "load_N": 60}',
}


class MalformedCommandError(ValueError):
    """A request that cannot be put to the guard; the text says what is wrong with it."""


class ModelsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The value of ``models``: a set is meant by its whole id."""

    action: Literal["add", "shadow", "promote", "rollback"]
    set: Annotated[str, msgspec.Meta(pattern=r"^([0-9a-f]{16})?\Z")] = ""


class ClientRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The payload of a command: ``id`` is any text that the asker has not used before, such as a
    UUID."""

    id: Annotated[str, msgspec.Meta(pattern=REQUEST_ID)]
    value: Any = None


Said = Annotated[str, msgspec.Meta(max_length=80, pattern=r"^[^\x00-\x1f\x7f]*\Z")]


class BypassRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The value of ``bypass`` and ``shelve``; no seconds end it."""

    target: Said
    seconds: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
    owner: Said = ""
    reason: Said = ""


def read(verb: str, payload: bytes) -> ClientRequest:
    """The request in ``payload``.

    Raises
    ------
    MalformedCommandError
        It is no JSON object with an id.
    """
    example = f', "value": {_EXAMPLES[verb]}' if verb in _EXAMPLES else ""
    form = (
        "send a JSON object with a new id of 1 to 64 printable characters: "
        f'{{"id": "7f3a"{example}}}'
    )
    if not payload:
        raise MalformedCommandError(f"{verb}: the payload is empty; {form}")
    try:
        return from_json(payload, ClientRequest, PAYLOAD_LIMIT_BYTES)
    except OutsideError as error:
        raise MalformedCommandError(f"{verb}: the payload is {error}; {form}") from error


def parse(seq: int, verb: str, value: object, origin: str, request_id: str = "") -> CommandRequest:
    """The request that ``verb`` with ``value`` means.

    Raises
    ------
    MalformedCommandError
        Unknown verb, or a value that the verb does not take.
    """
    if verb not in (*VERBS, *BRAIN_VERBS):
        raise MalformedCommandError(
            f"verb '{verb}' is unknown; use one of {', '.join((*VERBS, *BRAIN_VERBS))}"
        )
    request = CommandRequest(seq=seq, verb=verb, origin=origin, id=request_id)
    if verb == "mode":
        return msgspec.structs.replace(request, mode=_mode(value))
    if verb in UNITS:
        return msgspec.structs.replace(request, value=_number(verb, value))
    if verb in ("bypass", "shelve"):
        bypass = _bypass(verb, value)
        return msgspec.structs.replace(
            request, target=bypass.target, value=float(bypass.seconds), owner=bypass.owner,
            reason=bypass.reason,
        )  # fmt: skip
    if verb == "announce":
        return msgspec.structs.replace(request, ramp=_ramp(value))
    if verb == "commission":
        if value not in COMMISSION_ACTIONS:
            raise MalformedCommandError(
                f"commission: {_shown(value)} is none of {', '.join(COMMISSION_ACTIONS)}"
            )
        return msgspec.structs.replace(request, action=str(value))
    if verb == "models":
        wish = _models(value)
        return msgspec.structs.replace(request, action=wish.action, target=wish.set)
    if value is not None:
        raise MalformedCommandError(f"{verb}: takes no value, got {_shown(value)}; leave it away")
    return request


def _number(verb: str, value: object) -> float:
    # The bound comes first: an integer of hundreds of digits has no float.
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not -1e9 < value < 1e9
        or not math.isfinite(value)
    ):
        raise MalformedCommandError(
            f"{verb}: needs one finite number ({UNITS[verb]}), got {_shown(value)}"
        )
    return float(value)


def _ramp(value: object) -> PlannedRamp:
    try:
        return msgspec.convert(value, PlannedRamp)
    except (msgspec.ValidationError, OverflowError) as error:
        said = str(error)[:SAID_LETTERS]
        raise MalformedCommandError(
            f"announce: {said}; send e.g. {_EXAMPLES['announce']} as the value"
        ) from error


def _bypass(verb: str, value: object) -> BypassRequest:
    try:
        return msgspec.convert(value, BypassRequest)
    except (msgspec.ValidationError, OverflowError) as error:
        said = str(error)[:SAID_LETTERS]
        raise MalformedCommandError(
            f"{verb}: {said}; send e.g. {_EXAMPLES[verb]} as the value"
        ) from error


def _models(value: object) -> ModelsRequest:
    try:
        return msgspec.convert(value, ModelsRequest)
    except msgspec.ValidationError as error:
        raise MalformedCommandError(
            f"models: {str(error)[:SAID_LETTERS]}; send e.g. {_EXAMPLES['models']} as the value, "
            f"with one of {', '.join(MODELS_ACTIONS)}"
        ) from error


def _mode(value: object) -> int:
    names = [mode.name.lower() for mode in Mode]
    if value not in names:
        raise MalformedCommandError(f"mode: {_shown(value)} is none of {', '.join(names)}")
    return Mode[str(value).upper()]


def _shown(value: object) -> str:
    """``value`` for a refusal: short, whatever somebody sent."""
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and not -(1 << 63) < value < 1 << 63:
        return "a number beyond 64 bits"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
