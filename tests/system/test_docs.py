"""README and docs: every command runs, every block of code works, every link, picture and key
exists.

How blocks are tried, document by document, in an empty folder:
- toml: saved under the name in its first line.
- python: run in one namespace per document; what begins with the name of a file of `laisn` is a
  change of it, which `tests/laisn/test_extending.py` makes in a copy.
- bash: `laisn` and `python` lines are run, in this process, each command without the plugins of
  those before it. Missions are cut to 20 s (`--set
  duration_s=20` for scenarios), films are left out, and stills are taken at 10 s, of which the
  first of a document is rendered; of a scenario's flights the first has its report drawn. Studies
  of a file are cut to 20 s, two realizations and two runs; of the others only their help, which
  must list the options. `make` targets must exist. Other programs are not ours.
"""

import ast
import re
import runpy
import shlex
import sys
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.flight.fly import fly
from experiments.flight.library import FOLDER, scenario_names
from experiments.study.file import StudyFile, study_of
from experiments.study.plan import plan_of
from laisn_sim.cli.main import app
from laisn_sim.cli.studies import BUILT_IN
from reports import flight_report
from sim.film import graphics
from sim.scenario.file import parse, validate
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.tracking import track_errors
from tests.without_plugins import without_plugins
from tools.documents import markers, route_keeping
from tools.documents import scenario_reference as reference
from tools.documents.tables import TRACKED

pytestmark = pytest.mark.system

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").glob("*.md")),
]
STUDIES = ("study", *BUILT_IN)
FOREIGN = ("apt-get", "pip", "podman", "rerun", "sbatch", "source", "srun")
"""Programs that are not ours to try."""


class Block(NamedTuple):
    """A fenced block of a document."""

    language: str
    text: str


def prose(document: Path) -> str:
    """A document without its blocks."""
    return re.sub(
        r"^```.*?^```", "", document.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )


def blocks(document: Path) -> list[Block]:
    matches = re.findall(
        r"^```(\w*)\n(.*?)^```",
        document.read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    return [Block(*language_and_text) for language_and_text in matches]


def commands(text: str) -> list[list[str]]:
    """Lines of a bash block as words, without comments; a redirection stays as the last two
    words.
    """
    joined = text.replace("\\\n", " ")
    return [words for line in joined.splitlines() if (words := shlex.split(line, comments=True))]


def shortened(words: list[str]) -> list[str]:
    """A `laisn` command as it is tried."""
    words = [*words]
    if words[0] in ("fly", "render") and not words[1].endswith(".mcap"):
        words += ["--set", "duration_s=20"]
    if words[0] == "fly" and "--no-video" not in words:
        words.append("--no-video")
    if words[0] == "study":
        words += ["--set", "duration_s=20", "--runs", "2", "--workers", "1"]
        words += [] if "--vary" in words else ["--realizations", "2"]
    if "--still" in words:
        words[words.index("--still") + 1] = "10"
    return words


def skip_rendering(patch: pytest.MonkeyPatch) -> None:
    """Have the renderer get an empty picture, after its arguments have been checked."""
    program = (
        "import pickle, sys, numpy; pickle.dump(numpy.zeros((2, 2, 4), numpy.uint8), "
        "sys.stdout.buffer)"
    )
    patch.setattr(graphics, "child", lambda *_: ([sys.executable, "-c", program], None))


def run_laisn(words: list[str], already_drawn: set[str]) -> None:
    """Run a `laisn` command; `already_drawn` are scenarios whose report has been drawn and is not
    drawn again.

    It also holds "render" once a still has been rendered.
    """
    is_run = (
        words[0] == "study"
        and words[1].endswith(".toml")
        and "--dry-run" not in words
        and "--film" not in words
    )
    if words[0] in STUDIES and not is_run:
        help_result = CliRunner().invoke(app, [words[0], "--help"], env={"COLUMNS": "200"})
        assert help_result.exit_code == 0, help_result.output
        for option in (word for word in words if word.startswith("--")):
            assert option in help_result.output, f"laisn {words[0]} has no {option}"
        return
    target = None
    if ">" in words:
        words, target = words[: words.index(">")], words[words.index(">") + 1]
    if words[0] == "render" and graphics.working() is None:
        return
    if words[0] == "render" and "--still" not in words:
        words = [*words, "--still", "10", "--out", "film.png"]
    with without_plugins(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(flight_report, "DRAWN_FOLLOWERS", 2)
        if words[0] in already_drawn:
            skip_rendering(patch)
        if words[0] == "fly" and words[1] in already_drawn:
            patch.setattr(
                flight_report, "flight_report", lambda *arguments: arguments[3].write_text("")
            )
        result = CliRunner().invoke(app, shortened(words))
    assert result.exit_code == 0, f"laisn {' '.join(words)}\n{result.output}"
    if words[0] in ("fly", "render"):
        already_drawn.add(words[1] if words[0] == "fly" else words[0])
    if target:
        Path(target).write_text(result.stdout, encoding="utf-8")


def run_python(words: list[str]) -> None:
    if words[0] == "-m":
        # these write documents of the repository; that they are up to date is tested by itself
        assert (ROOT / (words[1].replace(".", "/") + ".py")).is_file()
        return
    runpy.run_path(str(ROOT / words[0]), run_name="__main__")


def run_line(words: list[str], already_drawn: set[str]) -> None:
    program, *rest = words
    if program == "laisn":
        run_laisn(rest, already_drawn)
    elif program == "python":
        run_python(rest)
    elif program == "make":
        makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
        assert re.search(rf"^{rest[0]}:", makefile, flags=re.MULTILINE), (
            f"there is no target {rest[0]}"
        )
    else:
        assert program in FOREIGN, f"{program} is not known to these documents"


@pytest.mark.usefixtures("no_plugins")
@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_commands_and_code_work(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    # examples read its data
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    namespace: dict[str, object] = {}
    already_drawn: set[str] = set()
    for language, text in blocks(document):
        if language == "toml":
            name = re.match(r"# (\S+\.toml)\n", text)
            assert name, "a toml block begins with the name of its file"
            (tmp_path / name[1]).write_text(text, encoding="utf-8")
        elif language == "python" and (name := re.match(r"# (\w+\.py)\n", text)):
            (tmp_path / name[1]).write_text(text, encoding="utf-8")
        elif language == "python" and not text.startswith(("# laisn/", "# sim/")):
            exec(compile(text, str(document), "exec"), namespace)
        elif language == "python":
            assert (ROOT / text.splitlines()[0].removeprefix("# ")).is_file()
        elif language == "bash":
            for words in commands(text):
                run_line(words, already_drawn)
        else:
            assert language in ("bibtex", "math", "csv"), (
                f"a block of {language!r} is not tried by anything"
            )


def inline_commands(document: Path) -> list[list[str]]:
    spans = re.findall(r"`((?:laisn|make|python -m) [^`]*)`", prose(document))
    return [shlex.split(re.sub(r"\s+", " ", span)) for span in spans]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_commands_in_the_text_exist(document: Path) -> None:
    for program, *rest in inline_commands(document):
        if program == "make":
            run_line([program, *rest], set())
        elif program == "python":
            module = ROOT / rest[1].replace(".", "/")
            files = (module.with_suffix(".py"), module / "__main__.py")
            assert rest[1].endswith("…") or any(file.is_file() for file in files)
        else:
            command_words = 2 if rest[0] == "log" else 1
            help_result = CliRunner().invoke(
                app, [*rest[:command_words], "--help"], env={"COLUMNS": "200"}
            )
            assert help_result.exit_code == 0, f"laisn {' '.join(rest)}"
            if rest[0] == "fly" and re.fullmatch(r"\w[\w-]*", "".join(rest[1:2])):
                assert rest[1] in scenario_names()


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_links_and_pictures_exist(document: Path) -> None:
    text = prose(document)
    targets = re.findall(r"\]\(([^)]+)\)", text) + re.findall(r'src="([^"]+)"', text)
    for target in targets:
        if target.startswith(("http://", "https://")):
            continue
        path, _, anchor = target.partition("#")
        linked = (document.parent / path).resolve() if path else document
        assert linked.exists(), f"{target} does not exist"
        if anchor:
            headings = re.findall(
                r"^#+ (.*)$", linked.read_text(encoding="utf-8"), flags=re.MULTILINE
            )
            assert anchor in {
                re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings
            }, target
    for source in re.findall(
        r"`((?:laisn|sim|models|experiments|tools|tests|docs|examples)/[\w./-]+\.\w+)`", text
    ):
        assert (ROOT / source).is_file(), f"{source} does not exist"


def test_every_picture_is_shown() -> None:
    texts = [document.read_text(encoding="utf-8") for document in DOCUMENTS]
    for picture in (ROOT / "docs" / "pictures").iterdir():
        assert any(f"pictures/{picture.name}" in text for text in texts), picture.name


def keys(model: object = Scenario, prefix: str = "") -> set[str]:
    """All keys of a scenario as section.key; a section whose keys the user declares stands for
    them.
    """
    names = set()
    for name, field in model.model_fields.items():  # type: ignore[attr-defined]
        section = next(
            (
                candidate
                for candidate in (field.annotation, *getattr(field.annotation, "__args__", ()))
                if hasattr(candidate, "model_fields")
            ),
            None,
        )
        names |= (
            {f"{prefix}{name}"}
            if not getattr(section, "model_fields", {})
            else keys(section, f"{prefix}{name}.")
        )
    return names


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_keys_exist(document: Path) -> None:
    known_keys = keys()
    sections = {key.rpartition(".")[0] for key in known_keys if "." in key}
    for mentioned in re.findall(r"`((?:\w+\.)+\w+)(?: = [^`]*)?`", prose(document)):
        if mentioned.split(".")[0] in sections and not mentioned.endswith(
            (".py", ".md", ".toml", ".json")
        ):
            assert re.sub(r"\.(\d+|N)", "", mentioned) in known_keys | sections, (
                f"{mentioned} is no key of a scenario"
            )
    for section in re.findall(r"`\[+([\w.]+)\]+`", prose(document)):
        assert section in known_keys | sections | set(StudyFile.model_fields) | {"quick"}, (
            f"there is no section {section}"
        )


def toml_files_of_documents() -> list[tuple[Path, str, dict[str, Any]]]:
    """Documents, names and contents of all TOML files that they show."""
    return [
        (document, text.split()[1], tomllib.loads(text))
        for document in DOCUMENTS
        for language, text in blocks(document)
        if language == "toml"
    ]


def test_missions_and_studies_of_documents_have_different_folders() -> None:
    """A folder out/NAME holds the results of one of them."""
    names_by_kind = {
        is_study: {
            name
            for _, name, table in toml_files_of_documents()
            if ("scenario" in table) == is_study
        }
        for is_study in (False, True)
    }
    assert all(names_by_kind.values())
    assert not names_by_kind[False] & names_by_kind[True]


def test_missions_with_stations_in_documents_use_the_tightly_coupled_navigator() -> None:
    variants = {
        f"{document.name}, {name}": validate(table, name).navigation.variant
        for document, name, table in toml_files_of_documents()
        if "scenario" not in table and re.search(r"'(station|shape)':", repr(table))
    }
    assert "formation.md, pair.toml" in variants
    assert set(variants.values()) == {"tight"}


def test_the_readme_names_the_licence_of_bundled_codecs() -> None:
    assert re.search(
        r"`av` wheel[^.]*codecs under the GPL",
        " ".join((ROOT / "README.md").read_text("utf-8").split()),
    )


def test_every_example_has_a_docstring_and_is_named_in_a_document() -> None:
    examples = list((ROOT / "examples").glob("*.py"))
    assert examples
    for example in examples:
        assert ast.get_docstring(ast.parse(example.read_text(encoding="utf-8")))
        assert any(f"examples/{example.name}" in d.read_text(encoding="utf-8") for d in DOCUMENTS)


def test_reference_of_scenarios_is_up_to_date() -> None:
    assert reference.PATH.read_text(encoding="utf-8") == reference.text(), "run make figures"


def test_numbers_in_documents_are_those_of_the_records() -> None:
    records = markers.records()
    for path in DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        assert markers.filled(text, records) == text, f"{path.name}: run make figures"


def test_route_errors_match_the_record() -> None:
    """One route is flown whole, as the recorded errors are those of whole routes. The tolerance is
    one of the last digit, as other machines may round otherwise.
    """
    recorded = markers.records()["route-keeping"]
    reports = route_keeping.measure(route_keeping.scenario(("T8",)))
    fresh = route_keeping.findings_of(reports, reports[1])
    for name in ("leader", "T8"):
        for quantity, spec in TRACKED.items():
            old, new = (
                float(findings[f"{quantity} {name}"].value or 0.0) for findings in (recorded, fresh)
            )
            assert abs(old - new) <= 10.0 ** -int(spec[1]), (
                f"{quantity} of {name}: run make studies"
            )


def test_closed_loops_match_the_record() -> None:
    """One route in one run is within half of the printed median, as flying all of them takes
    minutes.
    """
    record = markers.records()["closed-loop"]
    if markers.is_stale(record):
        pytest.skip("the record is of other sources: run make studies")
    arms = {entry.arm: entry.scenario for entry in plan_of(study_of("closed-loop", {})).entries}
    mission = arms["laisn-2 estimate"]
    one_follower = mission.model_copy(
        update={"followers": mission.followers[1:2], "duration_s": 200.0}
    )
    flight, _ = fly(one_follower)
    measured = float(
        np.sqrt(np.mean(track_errors(MotionSettings.of(flight.scenario), flight.trajectory) ** 2))
    )
    assert record["lost-runs laisn-2 T3"].value == 0
    assert measured == pytest.approx(float(record["off laisn-2 T3"].value or 0.0), rel=0.5)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.toml")), ids=lambda path: path.stem)
def test_built_in_scenarios_begin_with_a_description_and_pass_check(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert re.match(r"# [a-z].{20,110}\n", text)
    assert parse(text, str(path))["name"] == path.stem
    assert CliRunner().invoke(app, ["check", path.stem]).exit_code == 0


def test_the_citation_has_the_version_of_the_project() -> None:
    project_version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]["version"]
    assert f"\nversion: {project_version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
