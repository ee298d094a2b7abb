"""Every command line that the documents show: the quick ones run, the options of the others are
parsed."""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from firmware_py import cli

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [
    ROOT / "README.md",
    *sorted((ROOT / "deploy").glob("*.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    ROOT / "Makefile",
]
COMMAND = re.compile(r"(?:^|/|\s)(?<!-aG )(?<!--gid )orbitd ((?:[a-z]|--)\S*(?: .*)?)$")
ALONE = ("--help", "--version")
NEVER = ("install",)
"""Changes this machine; the boot test runs it."""
STAND_INS = {
    "my_rig": str(ROOT / "firmware_py/rigs/bench"),
    "old.toml": str(ROOT / "tests/config/first_schema/bench.toml"),
    "MODEL": "actor",
    "KIND": "orbit",
    "VERB": "status",
    "NAME": "two",
    "FAULT": "unbalance",
}


class Parsed(Exception):
    """Options were understood; nothing is run."""


def commands() -> list[tuple[str, str]]:
    """Document and command line, without the word `orbitd`."""
    found: dict[str, str] = {}
    for document in DOCUMENTS:
        for line in document.read_text().splitlines():
            texts = (
                [line]
                if line.startswith("    ")
                else re.findall(r"`(?:[^` ]*/bin/)?(orbitd [^`]+)`", line)
            )
            for part in (
                part for text in texts for part in re.split(r"&&|;|,\s|\s#\s|\s\|\s", text)
            ):
                if match := COMMAND.search(part.rstrip(" &")):
                    found.setdefault(match[1].strip(), document.name)
            for match in re.finditer(r'DEMO="([^"]*)"', line):
                found.setdefault(f"demo {match[1]}", document.name)
    return [(name, text) for text, name in found.items()]


def alternatives(text: str) -> list[list[str]]:
    """``train a|b --x`` as one command line for each alternative; placeholders get an example."""
    words = [STAND_INS.get(word, word) for word in shlex.split(text)]
    for at, word in enumerate(words):
        if re.fullmatch(r"[a-z]+(\|[a-z]+)+", word):
            return [[*words[:at], one, *words[at + 1 :]] for one in word.split("|")]
    return [words]


def parses(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> str:
    """Empty when the command's own parser understands ``arguments``, else what it says."""
    import argparse

    parse: Callable[..., argparse.Namespace] = argparse.ArgumentParser.parse_args

    def only_parse(
        self: argparse.ArgumentParser, *given: object, **named: object
    ) -> argparse.Namespace:
        parse(self, *given, **named)  # type: ignore[arg-type]
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", only_parse)
    said = io.StringIO()
    point = {p.name: p for p in importlib.metadata.entry_points(group=cli.GROUP)}.get(arguments[0])
    if point is None:
        return f"no command {arguments[0]}"
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        try:
            point.load()(arguments[1:])
        except Parsed:
            return ""
        except SystemExit as ended:
            return "" if ended.code == 0 else said.getvalue()
        except ModuleNotFoundError as missing:
            return "" if missing.name in cli.EXTRA_OF else str(missing)
    return said.getvalue()


FOUND = commands()


def test_the_documents_were_read() -> None:
    texts = [text for _, text in FOUND]
    assert len(texts) > 25, texts
    assert any(text.startswith("inject unbalance 40") for text in texts)


@pytest.mark.parametrize(("document", "text"), FOUND)
def test_a_documented_command_is_understood(
    document: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for arguments in alternatives(text):
        if arguments[0].isupper() or arguments[0] in NEVER:
            continue
        if len(arguments) == 1 and arguments[0] not in ALONE:
            assert arguments[0] in dict(cli.SUMMARIES), f"{document}: no command {arguments[0]}"
            continue
        if arguments[0] in ("--help", "--version"):
            assert cli.main(arguments) == 0
            continue
        with monkeypatch.context() as patch:
            said = parses([word for word in arguments if word != "..."], patch)
        assert not said, f"{document}: orbitd {text}\n{said}"


def test_a_wrong_document_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        assert "unrecognized arguments" in parses(["status", "--jsn"], patch)
    assert parses(["fly"], monkeypatch) == "no command fly"


@pytest.mark.parametrize(
    "target", sorted(set(re.findall(r"`?make ([a-z][a-z-]+)", (ROOT / "README.md").read_text())))
)
def test_a_documented_target_is_there(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
