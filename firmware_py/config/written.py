"""Writes a configuration as a rig folder, with what people remarked in the file it comes from."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.config.schema import Config
from firmware_py.config.source import ConfigFile
from firmware_py.errors import OrbitdError
from firmware_py.machine import Machine
from firmware_py.machine.folder import DEVICE, MACHINE, MODELS
from firmware_py.machine.migrate import first_key
from firmware_py.machine.values import MachineTable, Section

_HEADS: Final = {
    MACHINE: (
        "# What the machine `{name}` is.  Every key has its unit in its name; a key behind a # has "
        "its",
        "# default.",
    ),
    DEVICE: (
        "# How the device runs on the rig `{name}`.  Every key has its unit in its name; a key "
        "behind a",
        "# # has its default.  `orbitd check FOLDER` says what is wrong.",
    ),
}
_REMARK: Final = re.compile(
    r"""^(?:[^"'#]|"(?:[^"\\]|\\.)*"|'[^']*')*(\#.*)$"""  # a # that is in no text
)
_KEY_OF_REMARK: Final = re.compile(r"#\s*(?:\[*([\w.]+)\]*$|([A-Za-z0-9_]+)\s*=)")


class FolderError(OrbitdError):
    """The rig folder could not be written; the text says why, and what to do."""

    exit_code = 2


@dataclass
class Remarks:
    """Comments of a file by the key beside which they stand; all of the file, none lost."""

    top: list[str] = field(default_factory=list)
    above: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    beside: dict[str, str] = field(default_factory=dict)
    below: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    @classmethod
    def of(cls, file: ConfigFile) -> Remarks:
        """Those of ``file``.

        Lines directly above a key belong to it, others to the key before them.
        """
        found, keys = cls(), {number: key for key, number in sorted(file.lines.items())}
        pending: list[str] = []
        last = ""
        for number, line in enumerate(map(str.strip, file.text.split("\n")), 1):
            if key := keys.get(number):
                found.above[key] += pending
                if remark := _REMARK.match(line):
                    found.beside[key] = remark[1]
                pending, last = [], key
            elif line.startswith("#"):
                pending.append(line)
            else:
                (found.below[last] if last else found.top).extend(pending)
                pending = []
        (found.below[last] if last else found.top).extend(pending)
        return found


def rig_texts(config: Config, file: ConfigFile | None = None) -> dict[str, str]:
    """The text of each file of the rig folder of ``config``.

    Of ``file``, of the first schema, from which ``config`` was read, its remarks are kept, and what
    it leaves to a default is left to it; without one every value is written.
    """
    remarks = Remarks.of(file) if file else Remarks()
    writer = _Writer(remarks, None if file is None else frozenset(file.lines))
    table = msgspec.to_builtins(config)
    machine = table.pop("machine")
    head = {name: [row.format(name=config.machine.name) for row in _HEADS[name]] for name in _HEADS}
    name = f'name = "{config.machine.name}"'
    return {
        MACHINE: _text([*head[MACHINE], *remarks.top, "", name], writer.tables(Machine, machine)),
        DEVICE: _text(head[DEVICE], writer.tables(Config, table)),
    }


def write_rig(texts: Mapping[str, str], folder: Path, models: Path | None = None) -> None:
    """Make ``folder`` with the files ``texts``, and a copy of the set ``models``: whole, or not at
    all.

    Raises
    ------
    FolderError
        Something of that name is there, or it cannot be made.
    """
    if folder.is_symlink() or folder.exists():
        raise FolderError(f"{folder}: is there already; name a folder that is not")
    try:
        part = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.absolute().parent))
    except (OSError, ValueError) as error:
        said = getattr(error, "strerror", None) or error
        raise FolderError(f"{folder}: {said}; name a folder that this user may make") from error
    try:
        for name, text in texts.items():
            with (part / name).open("w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        if models is not None:
            shutil.copytree(models, part / MODELS)
        part.chmod(0o755)
        part.rename(folder)
    except OSError as error:
        raise FolderError(f"{folder}: {error.strerror}; name another folder") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _text(head: list[str], rows: Iterator[str]) -> str:
    return "\n".join([*head, *rows]) + "\n"


@dataclass(frozen=True)
class _Writer:
    """Rows of TOML; ``written``: keys of the first schema that stand there (None: all)."""

    remarks: Remarks
    written: frozenset[str] | None

    def tables(self, cls: type[Section], table: dict[str, Any]) -> Iterator[str]:
        """Every table of ``table``, a ``cls``."""
        above = "machine." if cls is Machine else ""
        for name, value in table.items():
            for i, each in enumerate(value if isinstance(value, list) else [value]):
                if isinstance(each, dict):
                    listed = isinstance(value, list)
                    key = f"{above}{name}[{i}]" if listed else f"{above}{name}"
                    yield from self._table(key, f"[[{name}]]" if listed else f"[{name}]", each, i)

    def _table(self, key: str, head: str, table: dict[str, Any], number: int) -> Iterator[str]:
        yield ""
        old = first_key(key)
        there = self.written is None or any(each.startswith(old) for each in self.written)
        yield from self.remarks.above.get(old, ())
        yield self._beside(head if there else f"# {head}", old)
        yield from self.remarks.below.get(old, ())
        said = self._remarked(old, table)
        for name, value in table.items():
            own = first_key(f"{key}.{name}")
            if self.written is None or own in self.written or self._inline(own):
                if value is not None and (value or name not in MachineTable.__struct_fields__):
                    yield from self.remarks.above.get(own, ())
                    yield self._beside(f"{name} = {toml_value(value)}", own)
                    yield from self.remarks.below.get(own, ())
            elif not number and name not in said and name not in MachineTable.__struct_fields__:
                yield f"# {name} = {'?' if value is None else toml_value(value)}"

    def _inline(self, key: str) -> bool:
        """Whether ``key`` stands in an inline table: without a line of its own."""
        assert self.written is not None
        above = key.rpartition(".")[0]
        return above in self.written and not any(w.startswith(f"{above}.") for w in self.written)

    def _remarked(self, old: str, table: dict[str, Any]) -> set[str]:
        """Keys that a remark in this table names already."""
        lines = [
            line
            for key in (old, *(f"{old}.{name}" for name in table))
            for line in (*self.remarks.above.get(key, ()), *self.remarks.below.get(key, ()))
        ]
        return {found[2] for line in lines if (found := _KEY_OF_REMARK.match(line)) and found[2]}

    def _beside(self, row: str, key: str) -> str:
        remark = self.remarks.beside.get(key)
        return f"{row}  {remark}" if remark else row


def toml_value(value: Any) -> str:
    """``value`` as it is written in TOML."""
    if isinstance(value, bool | str | list | tuple):
        return json.dumps(value, ensure_ascii=False)
    return repr(value)
