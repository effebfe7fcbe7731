"""The film of a flight: messages and files where there is none."""

from pathlib import Path
from typing import Any

import av
import pytest
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from sim.film import graphics
from sim.film.render import RendererDiedError
from sim.log.contents import Contents
from sim.log.schema import message_class_of
from tests.laisn_sim.cli.flights import WITHOUT_FILM, without_notice

pytestmark = pytest.mark.system


@pytest.mark.usefixtures("without_report")
def test_without_graphics_a_flight_prints_one_line_on_the_missing_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graphics, "working", lambda: None)
    result = CliRunner().invoke(
        app, ["fly", "T5", "--set", "duration_s=20", "--out", str(tmp_path)]
    )
    assert result.exit_code == 0
    [line] = [line for line in result.output.splitlines() if "film" in line]
    assert (
        line
        == f"no film: no graphics library works here (laisn doctor reports why); {graphics.INSTALL}"
    )
    assert not (tmp_path / "flight.mp4").exists()


@pytest.mark.usefixtures("without_report")
def test_a_renderer_that_dies_costs_the_film_alone_and_gives_exit_code_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(*_: object, **__: object) -> None:
        raise RendererDiedError(
            "a process that renders frames ended with code 1\nZeroDivisionError: of the child"
        )

    monkeypatch.setattr("sim.film.render.render", die)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    result = CliRunner().invoke(
        app, ["fly", "T5", "--set", "duration_s=20", "--out", str(tmp_path / "o")]
    )
    assert result.exit_code == 1
    assert "no film: a bug in the program" in result.stdout.splitlines()
    assert f"results in {tmp_path / 'o'}" in result.stdout.splitlines()
    [traceback_file] = tmp_path.glob("laisn-failure-*.txt")
    assert len(without_notice(result.stderr).splitlines()) == 1
    assert "ended with code 1" in result.stderr
    assert f"the traceback is in {traceback_file}" in result.stderr
    assert "Traceback" not in result.output
    assert "ZeroDivisionError: of the child" in traceback_file.read_text()
    assert {path.name for path in (tmp_path / "o").iterdir()} == WITHOUT_FILM


@pytest.mark.skipif(graphics.working() is None, reason=graphics.MISSING)
@pytest.mark.usefixtures("without_report")
@pytest.mark.parametrize("in_log", [False, True])
def test_a_log_refers_to_the_film_beside_it_and_holds_a_small_one_by_choice(
    tmp_path: Path, in_log: bool
) -> None:
    """6 s at 30 times real time and 25 Hz: five frames of 800 × 450 pixels."""
    changes = {
        "duration_s": 6,
        "video.width_px": 800,
        "video.height_px": 450,
        "video.frame_rate_hz": 25,
        "video.in_log": str(in_log).lower(),
    }
    settings = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    result = CliRunner().invoke(app, ["fly", "T5", *settings, "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    with av.open(str(tmp_path / "flight.mp4")) as film:
        (stream,) = film.streams
        assert (stream.width, stream.height, stream.frames) == (800, 450, 5)
    log = Contents(tmp_path / "flight.mcap")
    reference = {"file": "flight.mp4", "frame_rate_hz": "25", "speed_up": "30.0"}
    assert log.metadata["film"] == reference
    assert ("/camera" in log.topics) == in_log
    panels = (tmp_path / "foxglove.json").read_text()
    assert ('"/camera"' in panels) == in_log
    if in_log:
        decoder = av.CodecContext.create("h264", "r")
        camera = log.topics["/camera"]
        image_class = message_class_of(camera.schema)
        access_units = [image_class.FromString(data).data for data in camera.data]
        pictures = [p for unit in access_units for p in decoder.decode(av.Packet(unit))]
        pictures += decoder.decode(None)
        assert [(p.width, p.height) for p in pictures] == [(640, 360)] * 5


@pytest.mark.parametrize("backend", [graphics.Backend("egl", True, "a renderer"), None])
def test_the_pitch_study_films_its_example_where_something_renders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: graphics.Backend | None
) -> None:
    run_options: dict[str, Any] = {}
    monkeypatch.setattr(graphics, "working", lambda: backend)
    monkeypatch.setattr(
        "experiments.study.study.run_studies", lambda *_, **options: run_options.update(options)
    )
    (tmp_path / "results.parquet").touch()
    result = CliRunner().invoke(
        app, ["asymmetry", "--film", "example", "--quick", "--out", str(tmp_path)]
    )
    assert (result.exit_code, run_options["film"]) == (0, "example" if backend else "")
    assert result.stderr == ("" if backend else f"no film: {graphics.MISSING}\n")
    assert CliRunner().invoke(app, ["asymmetry", "--quick", "--out", str(tmp_path)]).stderr == ""
    assert not run_options["film"]


def test_a_film_that_a_study_does_not_make_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graphics, "working", lambda: graphics.Backend("egl", True, "a renderer"))
    for name, film, expected in (
        ("asymmetry", "worst", "expected --film example"),
        ("loss", "example", "expected --film worst"),
        ("formation", "worst", "without films"),
    ):
        refused = CliRunner().invoke(app, [name, "--film", film])
        assert expected in refused.stderr


def test_a_built_in_study_runs_as_its_command_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_options: list[dict[str, Any]] = []
    monkeypatch.setattr(
        "experiments.study.study.run_studies", lambda *_, **options: run_options.append(options)
    )
    (tmp_path / "results.parquet").touch()
    options = ["--runs", "2", "--workers", "2", "--force", "--out", str(tmp_path)]
    first = CliRunner().invoke(app, ["reproduce", *options])
    second = CliRunner().invoke(app, ["study", "reproduce", *options])
    assert (first.exit_code, first.output) == (second.exit_code, second.output) == (0, first.output)
    assert run_options[0] == run_options[1]
    refused = CliRunner().invoke(app, ["study", "loss", "--quick"])
    assert "--quick: the study has no [quick]" in refused.stderr
