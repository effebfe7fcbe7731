"""Commands and code of README and docs, as a user types them, in order, in an empty folder.

Commands in the text, with names such as FILE in place of a user's own, are run on small files.
Blocks are run whole by `make typed` alone: missions, films and studies take hours. `test_docs.py`
runs the same blocks with cut missions.
"""

import os
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from sim.log import writer
from tests.synthetic import make_flight
from tests.system.test_docs import (
    DOCUMENTS,
    FOREIGN,
    ROOT,
    STUDIES,
    blocks,
    commands,
    inline_commands,
    run_python,
)
from tests.without_plugins import without_plugins

OWN_DATA = ROOT / "docs" / "own-data.md"
GUIDES = [document for document in DOCUMENTS if document.name != "CHANGELOG.md"]
COMPLETE_ALONE = ("scenarios", "vehicles", "doctor")
"""Commands that are complete by their name alone; of others the name alone is a mention."""


def files_of_a_user() -> None:
    """The files that commands in the text are about, in the current folder."""
    writer.write(make_flight(10.0), Path("flight.mcap"))
    Path("cut.mcap").write_bytes(Path("flight.mcap").read_bytes()[:-5])
    for language, text in blocks(OWN_DATA):
        if language == "python":
            exec(compile(text, str(OWN_DATA), "exec"), {})
        elif language == "toml":
            Path("mine.toml").write_text(text, encoding="utf-8")
    result = CliRunner().invoke(app, ["log", "import", "mine.csv", "--out", "mine.mcap"])
    assert result.exit_code == 0, result.output
    scenario = CliRunner().invoke(app, ["scenarios", "T5"])
    Path("my.toml").write_text(scenario.stdout, encoding="utf-8")
    model = ROOT / "tests" / "data" / "gazebo" / "torpedo.sdf"
    Path("model.sdf").write_text(model.read_text(encoding="utf-8"), encoding="utf-8")


def with_own_files(words: list[str]) -> list[str]:
    """A command with a user's files in place of the names in capitals."""
    log = "cut.mcap" if "recover" in words else "flight.mcap"
    file = "my.toml" if words[0] == "check" else log
    names = {
        "FILE": file,
        "FILE.mcap": "flight.mcap",
        "FOLDER": "tables",
        "BAG": "bag",
        "out/T5/flight.mcap": "flight.mcap",
        "LOG": "mine.mcap",
        "A": "flight.mcap",
        "B": "flight.mcap",
    }
    return [names.get(word, word) for word in words]


def is_complete(words: list[str]) -> bool:
    """Whether it is a command line rather than the mention of a command."""
    command_words = 2 if words[0] == "log" else 1
    return words[0] in COMPLETE_ALONE or any(
        not word.startswith("--") for word in words[command_words:]
    )


@pytest.mark.system
@pytest.mark.usefixtures("no_plugins")
@pytest.mark.parametrize("document", GUIDES, ids=lambda path: path.stem)
def test_command_lines_in_the_text_run(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [rest for program, *rest in inline_commands(document) if program == "laisn"]
    lines = [rest for rest in lines if is_complete(rest)]
    if not lines:
        return
    monkeypatch.chdir(tmp_path)
    files_of_a_user()
    for rest in lines:
        if rest[0] in ("fly", "render", "doctor", *STUDIES):
            # missions and studies are those of blocks or of `make typed`
            continue
        words = with_own_files(rest)
        capitals = [word for word in words if re.fullmatch(r"[A-Z]+(\.\w+)?", word)]
        assert not capitals, f"{capitals} in {rest}"
        words = words[: words.index(">")] if ">" in words else words
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, f"laisn {shlex.join(rest)}\n{result.output}"


def test_an_export_is_a_complete_command_without_a_folder() -> None:
    """Beside it, `laisn log recover` without a file is the mention of a command."""
    lines = [" ".join(words) for words in inline_commands(ROOT / "docs" / "log.md")]
    assert "laisn log export FILE" in lines
    assert is_complete(["log", "export", "FILE"])
    assert not is_complete(["log", "recover"])


def run_as_typed(words: list[str]) -> None:
    program, *rest = words
    target = rest[rest.index(">") + 1] if ">" in rest else None
    rest = rest[: rest.index(">")] if ">" in rest else rest
    if program == "python":
        run_python(rest)
    elif program == "laisn":
        with without_plugins():
            result = CliRunner().invoke(app, rest)
        assert result.exit_code == 0, f"laisn {shlex.join(rest)}\n{result.output}"
        if target:
            Path(target).write_text(result.stdout, encoding="utf-8")
    else:
        assert program in (*FOREIGN, "make")


@pytest.mark.typed
@pytest.mark.usefixtures("no_plugins")
@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_blocks_run_whole_as_typed(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    # commands of a checkout name these folders
    for folder in ("tests", "examples"):
        os.symlink(ROOT / folder, folder)
    namespace: dict[str, object] = {}
    for language, text in blocks(document):
        name = re.match(r"# (\S+\.(?:toml|py))\n", text)
        if name and not name[1].startswith(("laisn/", "sim/")):
            Path(name[1]).write_text(text, encoding="utf-8")
        elif language == "python" and not name:
            exec(compile(text, str(document), "exec"), namespace)
        elif language == "bash":
            for words in commands(text):
                run_as_typed(words)


def test_blocks_have_known_languages_and_tables_are_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Formulas and the citation are only read, so their blocks are not run."""
    monkeypatch.chdir(tmp_path)
    all_blocks = [block for document in DOCUMENTS for block in blocks(document)]
    assert {block.language for block in all_blocks} == {
        *("bash", "python", "toml", "csv"),
        *("math", "bibtex"),
    }
    for language, text in all_blocks:
        if language == "csv":
            Path("typed.csv").write_text(text, encoding="utf-8")
            words = ["log", "import", "typed.csv", "--out", "typed.mcap"]
            result = CliRunner().invoke(app, words)
            assert result.exit_code == 0, result.output
