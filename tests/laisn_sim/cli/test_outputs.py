"""Every command that writes a file names it, says when it replaces an earlier one, and spares its
input.
"""

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from experiments.campaign.store import columns_of, write_table
from experiments.flight import results
from experiments.flight.folder import LOG, REPORT, title_of
from experiments.study.study import RESULTS, RUNS, STUDY
from laisn_sim.cli.main import app
from laisn_sim.cli.outputs import REPLACED
from laisn_sim.cli.studies import BUILT_IN
from sim.log import writer
from tests.synthetic import make_flight

TABLE_HEADS = (
    "time [s],speed [m/s],heading_deg,depth,leader_timestamp,leader_east,leader_north,"
    "leader_heading_deg,leader_speed,leader_depth,range_rear\n"
)
SCENARIO = """
[leader]
waypoints = [[0, 0, 20], [60, 60, 20]]
[[followers]]
waypoints = [[0, 0, 0], [60, 60, 0]]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with a log of a flight, a damaged log, and the table of a vehicle."""
    monkeypatch.chdir(tmp_path)
    writer.write(make_flight(10.0), Path("a.mcap"))
    Path("cut.mcap").write_bytes(Path("a.mcap").read_bytes()[:-5])
    rows = "".join(f"{0.1 * k:.1f},1,90,8,{0.1 * k:.1f},{k},20,90,1,8,20\n" for k in range(99))
    Path("mine.csv").write_text(TABLE_HEADS + rows, encoding="utf-8")
    Path("mine.toml").write_text(SCENARIO, encoding="utf-8")
    return tmp_path


def write_still(*_: object, **__: object) -> None:
    Path("still.png").write_bytes(b"png")


BENCHMARK = Path(__file__).resolve().parents[3] / "examples" / "benchmark"
COMMANDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "compare": ("compare a.mcap a.mcap", ("out/compare/a-a.html",)),
    "render": ("render a.mcap --still 5 --out still.png", ("still.png",)),
    "replay": ("replay a.mcap --out again.mcap", ("again.mcap",)),
    "sea": ("sea mine.toml --set duration_s=20", ("out/sea/mine.html",)),
    "view": ("view a.mcap --no-open", ("out/view/a.html",)),
    "range-budget": ("range-budget a.mcap --out shares.csv", ("shares.csv",)),
    "bound": ("bound T5 --set motion=kinematic --set duration_s=10 --out b.csv", ("b.csv",)),
    "log export": ("log export a.mcap tables", ("tables/leader_state.parquet",)),
    "log import": ("log import mine.csv --out mine.mcap", ("mine.mcap",)),
    "pitch": ("pitch --out out/pitch.html --csv map.csv", ("out/pitch.html", "map.csv")),
    "score": (
        f"score --navigator dead-reckoning --data {BENCHMARK} --mission astern --out scores.csv",
        ("scores.csv",),
    ),
    "log recover": ("log recover cut.mcap", ("cut.recovered.mcap",)),
}
"""Commands that write single files, as they are tried, and files of theirs."""
FOLDERS = {"fly", "study", "bench-data", "figure", *BUILT_IN}
"""Commands that write a folder of results, whose rules tests of flights and studies cover."""
READERS = {"scenarios", "vehicles", "check", "doctor", "hull", "log info"}
"""Commands that write to the terminal alone."""


def every_command() -> set[str]:
    group = typer.main.get_command(app)
    names = set[str]()
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        inner = getattr(command, "commands", None)
        names |= {f"{name} {sub}" for sub in inner} if inner else {name}
    return names


def test_every_command_is_listed_by_what_it_writes() -> None:
    assert every_command() == {*COMMANDS, *FOLDERS, *READERS}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_names_its_file_and_says_when_it_replaces_one(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results, "render", write_still)
    words, files = COMMANDS[name]
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    texts = []
    for _ in range(2):
        result = CliRunner().invoke(app, words.split(), env={"COLUMNS": "300"})
        assert result.exit_code == 0, result.output
        texts.append(" ".join(result.output.split()))
    for file in files:
        assert Path(file).is_file()
        assert file in texts[0]
        assert f"{file} ({REPLACED})" not in texts[0]
        assert f"{file} ({REPLACED})" in texts[1]
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("replay a.mcap --out a.mcap", "expected another file than the input"),
        ("replay a.mcap --out again.csv", "ends in .mcap"),
        ("range-budget a.mcap --out shares.txt", "ends in .csv or .parquet"),
        ("view a.mcap --no-open --out page.txt", "ends in .html"),
        ("compare a.mcap a.mcap --out page.txt", "ends in .html"),
        ("render a.mcap --still 5 --out still.mp4", "ends in .png"),
        ("pitch --csv map.txt", "--csv: expected a file name that ends in .csv"),
        ("log import mine.csv --out mine.toml", "ends in .mcap"),
        ("log import mine.csv --out mine.csv/a.mcap", "the folder mine.csv cannot be made"),
    ],
)
def test_files_that_a_command_must_not_write_are_refused_before_any_is_written(
    words: str, text: str
) -> None:
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    result = CliRunner().invoke(app, words.split(), env={"COLUMNS": "300"})
    assert result.exit_code == 2
    assert text in result.output
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before


def stored_study(folder: Path, baselines: tuple[float, ...]) -> Path:
    """A stored study of two runs at each of these baselines."""
    folder.mkdir()
    rows = [
        {
            "point": p,
            "realization": 0,
            "run": run,
            "seed": 1,
            "leader.baseline_m": baseline,
            "e_p_mean_m": 1.0 + run,
        }
        for p, baseline in enumerate(baselines)
        for run in range(2)
    ]
    write_table(folder / RUNS, columns_of(rows))
    write_table(folder / RESULTS, columns_of([row for row in rows if not row["run"]]))
    (folder / STUDY).write_text("runs = 2\n", encoding="utf-8")
    return folder


def test_studies_without_a_common_point_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    stored_study(Path("a"), (1.0, 2.0))
    stored_study(Path("b"), (2.0, 0.5))
    stored_study(Path("c"), (0.25, 0.5))
    with_common_point = CliRunner().invoke(app, ["compare", "a", "b"])
    assert with_common_point.exit_code == 0, with_common_point.output
    assert Path("out/compare/a-b.html").is_file()
    without_common_point = CliRunner().invoke(app, ["compare", "a", "c"], env={"COLUMNS": "400"})
    assert without_common_point.exit_code == 2
    assert "a and c have no point in common" in without_common_point.output
    assert (
        "points of a: leader.baseline_m = 1.0; leader.baseline_m = 2.0"
        in without_common_point.output
    )
    assert not Path("out/compare/a-c.html").exists()


def test_what_is_made_of_two_flights_has_two_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each flight's log is FOLDER/flight.mcap: its tables, pages and figures are named after the
    folder.
    """
    monkeypatch.chdir(tmp_path)
    for name in ("first", "second"):
        Path(name).mkdir()
        writer.write(make_flight(10.0), Path(name) / LOG)
        assert title_of(Path(name) / LOG) == title_of(Path(name) / REPORT) == name
        for words in (f"view {name} --no-open", f"log export {name}/{LOG}", f"replay {name}"):
            result = CliRunner().invoke(app, words.split(), env={"COLUMNS": "300"})
            assert result.exit_code == 0, result.output
            assert REPLACED not in result.output
    monkeypatch.chdir(tmp_path / "first")
    assert title_of(Path(LOG)) == "first"
    monkeypatch.chdir(tmp_path)
    assert title_of(Path("first/other.mcap")) == "other"
    words = f"compare first/{LOG} second/{LOG}"
    result = CliRunner().invoke(app, words.split(), env={"COLUMNS": "300"})
    assert "page in out/compare/first-second.html" in result.output
    made = ("view/{}.html", "export/{}/leader_state.parquet")
    for name in ("first", "second"):
        assert all((Path("out") / file.format(name)).is_file() for file in made)
