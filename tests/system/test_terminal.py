"""What a terminal shows of names that others chose: the same characters, and nothing that steers
it.
"""

import io
import re
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.writer import Writer
from rich.console import Console
from rich.table import Table
from typer.testing import CliRunner

from experiments.campaign.progress import literal, print_line
from laisn.errors import printable, screenful
from laisn_sim.cli import replaying
from laisn_sim.cli.main import app

pytestmark = pytest.mark.system

ANY_NAMES = (
    st.text(
        st.sampled_from("[]/\\:=#@ab red\x00\x1b\x07\r\n\t\x9b\u202e\u2028\ud800😀°"), max_size=30
    )
    | st.text()
)


def printed_by(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def terminal() -> Console:
    """A console with colours, wide enough that no line is broken."""
    return Console(file=io.StringIO(), force_terminal=True, color_system="truecolor", width=10_000)


@given(ANY_NAMES)
@example("out[/tmp]")
@example("[/red]")
@example("[red]")
@example("\\[a]\\")
@example(":smile:")
@example("[link=http://x]y")
@example("\x1b]0;title\x07")
@example("\ud800")
def test_a_name_is_shown_as_it_is_and_steers_nothing(name: str) -> None:
    printable_name = printable(name)
    assert printable_name.isprintable() or re.search(r"\s", printable_name)
    assert not set(printable_name) & set("\x00\x1b\x07\r\n\t\x9b\u202e\u2028\ud800")
    printable_name.encode()
    console = terminal()
    print_line(console, name, "note:", "red")
    assert printed_by(console) == f"\x1b[31mnote: \x1b[0m{printable_name}\n"
    console = terminal()
    table = Table("x", box=None, pad_edge=False, show_header=False)
    table.add_row(literal(name))
    console.print(table)
    assert printed_by(console).rstrip() == printable_name.rstrip()


def test_visible_text_stays_as_it_is() -> None:
    text = "σ = 2° – “Łódź” … 水 [x] \\ :a:"
    assert printable(text) == text


@given(st.lists(ANY_NAMES, max_size=60), st.integers(4, 40))
def test_a_screen_shows_or_counts_every_message(lines: list[str], rows: int) -> None:
    """Lines are as they break at 80 columns."""
    shown_lines = screenful(lines, rows)
    assert sum(max(1, -(-len(line) // 80)) for line in shown_lines) <= rows + 1
    count_of_others = re.fullmatch(r"  … and (\d+) more", shown_lines[-1]) if shown_lines else None
    assert len(shown_lines) - bool(count_of_others) + (
        int(count_of_others[1]) if count_of_others else 0
    ) == len(lines)


def test_topics_of_a_log_are_no_markup(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    markup_name = "[/red][bold]\x1b[2J"
    with (tmp_path / "[x]").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(
            markup_name, "protobuf", writer.register_schema(markup_name, "protobuf", b"")
        )
        writer.add_message(channel, 0, b"", 0)
        writer.add_attachment(0, 0, markup_name, "", b"")
        writer.add_metadata(markup_name, {markup_name: markup_name})
        writer.finish()  # type: ignore[no-untyped-call]
    replaying.show_info(tmp_path / "[x]")
    printed = capsys.readouterr().out
    assert "/[x]: 0.00 MB" in printed
    assert printed.count("[/red][bold]\\x1b[2J") == 6
    assert "\x1b" not in printed


@pytest.mark.parametrize("folder", ["out[/tmp]", "[red]x", "a\x1b[2Jb"])
def test_a_folder_named_like_markup_takes_a_flight(folder: str, tmp_path: Path) -> None:
    out = tmp_path / folder
    result = CliRunner().invoke(
        app, ["fly", "T5", "--set", "duration_s=2", "--no-video", "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert f"results in {printable(out)}" in result.output
    assert (out / "summary.json").is_file()
