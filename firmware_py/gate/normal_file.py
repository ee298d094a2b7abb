"""The machine's normal state on disk: one JSON file, written whole by the gate, the one process
with a disk."""

from __future__ import annotations

import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.decoding import FILE_LIMIT_BYTES, OutsideError, from_json, read_file
from firmware_py.records import Normal

NAME: Final = "normal.json"


class NormalFile:
    """The stored state, read once at the start.

    Parameters
    ----------
    folder
        State folder; made when something is stored.
    unix_ns
        The calendar's time, stamped on what is stored.

    Attributes
    ----------
    normal
        What is stored, None without.
    trouble
        Empty, or why the file cannot be read or written.
    """

    def __init__(self, folder: Path, unix_ns: Callable[[], int]) -> None:
        self.path = folder / NAME
        self.normal: Normal | None = None
        self.trouble = ""
        self._unix_ns = unix_ns
        try:
            self.normal = from_json(read_file(self.path), Normal, FILE_LIMIT_BYTES)
        except FileNotFoundError:
            return
        except (OSError, OutsideError) as error:
            self.trouble = (
                f"{self.path}: cannot be used ({error}); commission again (`orbitd commission "
                f"start`), or "
                "forget it (`orbitd commission forget`)"
            )

    def keep(self, normal: Normal) -> Normal:
        """Store ``normal``, stamped with the time; what stood there before is replaced whole or not
        at all."""
        self.normal = msgspec.structs.replace(normal, made_unix_ns=self._unix_ns())
        part = self.path.with_suffix(".part")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with part.open("wb") as file:
                file.write(msgspec.json.format(msgspec.json.encode(self.normal), indent=1))
                file.flush()
                os.fsync(file.fileno())
            part.replace(self.path)
            self.trouble = ""
        except OSError as error:
            self.trouble = (
                f"{self.path}: cannot be written ({error.strerror}); what was learned is lost at a "
                "restart"
            )
        return self.normal

    def forget(self) -> None:
        """Remove the file."""
        self.normal = None
        try:
            self.path.unlink(missing_ok=True)
            self.trouble = ""
        except OSError as error:
            self.trouble = f"{self.path}: cannot be removed ({error.strerror}); remove it by hand"

    def words(self) -> str:
        """When the stored state was learned and over what, or what is wrong; empty without one."""
        if self.trouble or self.normal is None:
            return self.trouble
        made = datetime.fromtimestamp(self.normal.made_unix_ns * 1e-9, UTC)
        return (
            f"{made:%Y-%m-%d %H:%M} UTC, {self.normal.minutes:.1f} min at {self.normal.points} "
            "operating points"
        )
