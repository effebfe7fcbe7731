"""What help texts show: every unit, at any width."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from laisn_sim.cli.main import app

UNIT = re.compile(r"\[[^\]]*\]")


def commands(command: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The words of every command and subcommand."""
    yield words
    for name, inner in getattr(command, "commands", {}).items():
        yield from commands(inner, (*words, name))


ALL_COMMANDS = [*commands(typer.main.get_command(app))]


def help_text(*words: str) -> str:
    """The text of a command's help, on one line, without its frame."""
    result = CliRunner().invoke(app, [*words, "--help"])
    assert result.exit_code == 0
    return " ".join(re.sub("[│╭╮╰╯─]", " ", result.output).split())


def command_at(words: tuple[str, ...]) -> Any:
    command: Any = typer.main.get_command(app)
    for word in words:
        command = command.commands[word]
    return command


@pytest.mark.parametrize("words", ALL_COMMANDS, ids=" ".join)
def test_every_help_text_shows_what_is_in_brackets(words: tuple[str, ...]) -> None:
    """Every text is declared with them; Rich takes [m] for a style unless it is escaped."""
    text = help_text(*words)
    for option in command_at(words).params:
        declared = str(getattr(option, "help", "") or "").replace("\\[", "[")
        for unit in UNIT.findall(declared):
            assert unit in text


def test_units_of_hulls_and_films_are_shown() -> None:
    hull = help_text("hull")
    assert "length of the hull [m]" in hull
    assert "mass with all that floods [kg]; the hull is neutral" in hull
    assert "diameter of the propeller [m]; default: 0.7 of the hull" in hull
    assert "one picture at mission time T [s]" in help_text("render")


@pytest.mark.parametrize("columns", ["0", "1", "-5", "wide", ""])
def test_an_invalid_terminal_width_cuts_nothing_off(
    columns: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert "length of the hull [m]" in help_text("hull")
    # the command before this one removed it
    monkeypatch.setenv("COLUMNS", columns)
    assert "following-sea" in CliRunner().invoke(app, ["scenarios"]).output


def test_every_option_that_takes_a_measure_states_its_unit() -> None:
    """In brackets, or as seconds in words."""
    measures = {
        f"{' '.join(words)} {option.opts[-1]}": f"{option.metavar} {option.help}".replace(
            "\\[", "["
        )
        for words in ALL_COMMANDS
        for option in command_at(words).params
        if str(option.bare_type()).startswith("float")
    }
    assert {"hull --mass", "pitch --below", "replay --longest-gap"} <= set(measures)
    without_unit = [
        name for name, text in measures.items() if not re.search(r"\[.+\]|second", text.lower())
    ]
    assert without_unit == []
