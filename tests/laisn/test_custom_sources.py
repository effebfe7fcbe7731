"""All files that a plugin imports or reads are read anew, so that no result of other code is shown
or stored; its faults are reported as errors of the user's code.
"""

import os
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import laisn_sim
from experiments.campaign import campaign
from experiments.campaign.store import key_of
from laisn.custom_sources import Sources
from laisn.errors import LaisnError
from laisn_sim.cli.main import app

NAVIGATOR = """
import numpy as np
from laisn.estimates import Estimates, FixKind
{imports}

class Nav:
    def __init__(self, settings, start):
        self.settings, self.start = settings, start

    def run(self, measured):
        n, m = measured.speed.size, measured.message_step.size
        state = np.zeros((n, 4))
        state[:, :2] = self.start[:2]
        {further}
        return Estimates(
            state=state,
            covariance=np.full((n, 4, 4), np.nan),
            fix_step=measured.message_step,
            fix_position=np.full((m, 2), np.nan),
            fix_sigma=np.full(m, np.nan),
            fix_kind=np.full(m, FixKind.LOST),
            innovation=np.full((m, 2), np.nan),
            innovation_covariance=np.full((m, 2, 2), np.nan),
        )
"""
SETTINGS = {"duration_s": 2.0, "motion": "kinematic", "navigation.variant": "mynav:Nav"}
OPTIONS = [word for key, value in SETTINGS.items() for word in ("--set", f"{key}={value}")]
ADDS_GAIN = {"imports": "from helper import GAIN", "further": "state[:, 0] += GAIN"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_plugins: None) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")
    return tmp_path


def write(*, imports: str = "", further: str = "pass") -> None:
    """Write a navigator that stays at its start, with further imports and statements of `run`."""
    Path("mynav.py").write_text(NAVIGATOR.format(imports=imports, further=further))


def command(*arguments: str) -> Result:
    return CliRunner().invoke(app, [*arguments, "--plugin", "mynav.py"])


def east_error(gain: float, workers: int) -> float:
    """Error of a study of a navigator that adds a gain of a module beside it to its position."""
    Path("helper.py").write_text(f"GAIN = {gain}\n")
    laisn_sim.load_plugin("mynav.py")
    results = laisn_sim.study(
        "T5",
        set=SETTINGS,
        vary={"followers.0.depth_m": [10.0]},
        runs=1,
        out="out",
        workers=workers,
    )
    (row,) = results.table.rows()
    return float(row["e_p_mean_m"])


@pytest.mark.usefixtures("folder")
def test_a_study_shows_the_results_of_a_helper_as_it_is_now() -> None:
    """Also when the helper is edited within a second to a file of the same size, which a check of
    bytecode by time and size does not notice, and when it is edited back.
    """
    write(**ADDS_GAIN)
    errors = [east_error(gain, workers=1) for gain in (5e3, 7e3, 5e3)]
    # the follower is within metres of its start
    assert errors == pytest.approx([5e3, 7e3, 5e3], abs=5.0)
    assert errors[0] == errors[2]
    stored = len(list(Path("out/store").iterdir()))
    assert east_error(7e3, workers=1) == errors[1]
    assert len(list(Path("out/store").iterdir())) == stored


CHANGES = """
import os
if not os.path.exists("changed"):
    open("changed", "w").close()
    open("helper.py", "w").write("GAIN = 7000.0\\n")
"""


@pytest.mark.usefixtures("folder")
def test_an_edit_while_a_study_runs_ends_it() -> None:
    """No result of the old code is stored under the key of the new code, nor the reverse."""
    write(imports=ADDS_GAIN["imports"], further=CHANGES.strip().replace("\n", "\n        "))
    Path("helper.py").write_text("GAIN = 5000.0\n")
    options = ["--vary", "followers.0.depth_m=10,11,12", "--runs", "1", "--workers", "1"]
    result = command("study", "T5", *OPTIONS, *options)
    assert result.exit_code == 2, result.output
    assert "changed while the study ran; run it again" in result.output
    assert command("study", "T5", *OPTIONS, *options).exit_code == 0


@pytest.mark.usefixtures("folder")
def test_loading_after_an_edit_gives_the_new_module() -> None:
    write(**ADDS_GAIN)
    Path("helper.py").write_text("GAIN = 5.0\n")
    first = laisn_sim.load_plugin("mynav.py")
    assert laisn_sim.load_plugin("mynav.py") is first
    Path("helper.py").write_text("GAIN = 7.0\n")
    second = laisn_sim.load_plugin("mynav.py")
    assert (first.GAIN, second.GAIN, sys.modules["helper"].GAIN) == (5.0, 7.0, 7.0)
    Path("mynav.py").write_text("GAIN = 9.0\n")
    assert laisn_sim.load_plugin("mynav.py").GAIN == 9.0


def test_the_sources_of_a_plugin_are_all_files_of_the_user_s_that_it_reaches(folder: Path) -> None:
    files = {
        "mine.py": "import first, numpy, json\nimport laisn.fix\nfrom parts import second",
        "first.py": "def late():\n    from parts.inner import third\n    return open('gains.csv')",
        "parts/second.py": "from . import fourth\nimport importlib\n"
        "fifth = importlib.import_module('fifth')",
        "parts/fourth.py": "",
        "parts/inner/__init__.py": "from .third import x",
        "parts/inner/third.py": "x = 1",
        "fifth.py": "def broken(",
        "gains.csv": "1,2",
        "other.py": "",
        "other.csv": "",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    sys.path.append(str(folder))
    reached = Sources.of(folder / "mine.py")
    assert {str(path.relative_to(folder)) for path in reached.files} == {*files} - {
        "other.py",
        "other.csv",
    }
    for name in sorted(files):
        before = Sources.of(folder / "mine.py")
        (folder / name).write_text(f"{files[name]} ")
        after = Sources.of(folder / "mine.py")
        assert (before.digest == after.digest) == name.startswith("other")
        assert before.unchanged == name.startswith("other")


@pytest.mark.usefixtures("folder")
def test_the_key_of_a_result_holds_what_a_plugin_imports() -> None:
    write(**ADDS_GAIN)
    Path("helper.py").write_text("GAIN = 5.0\n")
    laisn_sim.load_plugin("mynav.py")
    scenario = laisn_sim.load("T5", SETTINGS)
    first = key_of(scenario)
    Path("helper.py").write_text("GAIN = 7.0\n")
    second = key_of(scenario)
    # the module in memory is the one that the key describes
    assert sys.modules["helper"].GAIN == 7.0
    Path("helper.py").write_text("GAIN = 5.0\n")
    os.utime("helper.py", (0, 0))
    assert [key_of(scenario) == key for key in (first, second)] == [True, False]


FAULTS = [
    ("1 / 0", "ZeroDivisionError: division by zero"),
    ("raise SystemExit(3)", "it ends the program (SystemExit: 3)"),
    ("__import__('sys').exit('enough')", "it ends the program (SystemExit: enough)"),
    ("raise type('Odd', (Exception,), {'__reduce__': None})('x')", "Odd: x"),
    ("open('gains.txt')", "FileNotFoundError"),
    ("raise __import__('laisn_sim').LaisnError('no gain')", "LaisnError: no gain"),
]


@pytest.mark.system
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("fault", "expected"), FAULTS)
@pytest.mark.parametrize("workers", [0, 1, 2])
def test_a_fault_of_a_plugin_names_file_line_and_calls(
    fault: str, expected: str, workers: int
) -> None:
    """In a flight (0), in a study, and in one whose workers are other processes."""
    write(imports=f"def deeper():\n    {fault}\n", further="deeper()")
    arguments = ["fly", "T5", *OPTIONS, "--no-video"]
    if workers:
        arguments = ["study", "T5", *OPTIONS, "--vary", "followers.0.depth_m=10,11"]
        arguments += ["--runs", "1", "--workers", str(workers)]
    result = command(*arguments)
    assert result.exit_code == 2, result.output
    assert "bug" not in result.output
    lines = [line.strip() for line in result.stderr.splitlines()]
    first_line = next(i for i, line in enumerate(lines) if line.startswith("laisn: plugin"))
    file = Path("mynav.py").resolve()
    assert lines[first_line].startswith(f"laisn: plugin {file}: {expected}")
    source = file.read_text().splitlines()
    line_number = source.index(f"    {fault}") + 1
    assert f'File "{file}", line {line_number}, in deeper' in lines
    assert lines[lines.index(f'File "{file}", line {line_number}, in deeper') + 1] == fault
    assert any(line.endswith("in run") for line in lines)


def end_the_process(*_: object, **__: object) -> None:
    os._exit(1)


@pytest.mark.system
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("workers", [1, 2])
def test_a_fault_is_told_also_where_the_process_that_compiles_ahead_dies(
    workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "compile_motion", end_the_process)
    write(further="1 / 0")
    arguments = ["study", "T5", *OPTIONS, "--vary", "followers.0.depth_m=10,11"]
    result = command(*arguments, "--runs", "1", "--workers", str(workers))
    assert result.exit_code == 2, result.output
    assert "ZeroDivisionError: division by zero" in result.stderr


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("further", "expected"),
    [
        ("state[4:, 1] = np.nan", "navigator Nav (mynav.py): its estimate at 0.5 s is [0.0, nan"),
        ("return {}", "navigator Nav (mynav.py) returned dict from `run`"),
        (
            "state, n = state[1:], n - 1",
            "navigator Nav (mynav.py): its states have the shape (19, 4); expected (20, 4)",
        ),
    ],
)
@pytest.mark.parametrize("study", [False, True])
def test_an_estimate_of_a_wrong_shape_type_or_value_names_the_class(
    further: str, expected: str, study: bool
) -> None:
    write(imports="", further=f"state[:, 0] = 0.0\n        {further}")
    arguments = ["fly", "T5", *OPTIONS, "--no-video"]
    if study:
        arguments = ["study", "T5", *OPTIONS, "--vary", "followers.0.depth_m=10", "--workers", "1"]
    result = command(*arguments)
    assert result.exit_code == 2, result.output
    assert expected in result.output


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("class Nav:\n    step = run = print\n    def __init__(self): pass", "navigator Nav: "),
        (
            "class Nav:\n    def __init__(self, s, start): pass\n    def step(self, own): pass",
            "navigator Nav (mynav.py): step: ",
        ),
        (
            "class Nav:\n    def __init__(self, s, start): self.state = 'here'\n"
            "    def step(self, own, reception, dt): pass",
            "navigator Nav (mynav.py): its `state` is 'here'; expected numbers of shape (4,)",
        ),
    ],
)
def test_a_class_with_other_arguments_or_state_is_named(text: str, expected: str) -> None:
    Path("mynav.py").write_text(text)
    result = command("fly", "T5", *OPTIONS, "--no-video")
    assert (result.exit_code, expected in result.output) == (2, True), result.output


@pytest.mark.usefixtures("folder")
def test_a_plugin_that_ends_the_program_is_named() -> None:
    Path("mynav.py").write_text("# ends\nraise SystemExit(3)\n")
    result = command("check", "T5")
    assert result.exit_code == 2
    assert "mynav.py cannot be imported: it ends the program (SystemExit: 3)" in result.output
    assert 'mynav.py", line 2' in result.output


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("raise type('Odd', (BaseException,), {})('base')", "Odd: base"),
        (
            "raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})",
            "Odd: its text cannot be made: ZeroDivisionError",
        ),
    ],
)
@pytest.mark.parametrize("at_import", [True, False])
def test_an_exception_without_text_or_of_an_odd_base_names_the_plugin(
    fault: str, expected: str, *, at_import: bool
) -> None:
    text = f"class Nav:\n    run = print\n    def __init__(self, settings, start):\n        {fault}"
    Path("mynav.py").write_text(fault if at_import else text)
    result = command("check", "T5") if at_import else command("fly", "T5", *OPTIONS, "--no-video")
    assert (result.exit_code, expected in result.output) == (2, True), result.output
    assert f'mynav.py", line {1 if at_import else 4}' in result.output


@pytest.mark.usefixtures("folder")
def test_a_plugin_that_is_not_there_is_named() -> None:
    result = command("check", "T5")
    assert (result.exit_code, "mynav.py: there is no such file" in result.output) == (2, True)
    with pytest.raises(LaisnError, match="no such file"):
        laisn_sim.load_plugin("nosuch.py")


SENSOR = """
import numpy as np

class Sensor:
    name = "odd"
    stream = 20
    acoustic = False

    def true(self, state):
        return np.zeros(len(state.hydrophone))

    def read(self, true, normals):
        return {value}
"""


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("true[1:]", "sensor Sensor (mynav.py): `read` gave array([0., 0."),
        (
            "None",
            "sensor Sensor (mynav.py): `read` gave None; expected numbers, a row for each of 20",
        ),
        ("[1, [2, 3]]", "sensor Sensor (mynav.py): `read` gave [1, [2, 3]]"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_sensor_that_reads_something_else_is_named(value: str, expected: str) -> None:
    Path("mynav.py").write_text(SENSOR.format(value=value))
    sensor_option = ["--set", "sensors.custom=[{sensor='mynav:Sensor'}]"]
    result = command(
        "fly", "T5", *OPTIONS, "--set", "navigation.variant=ekf", *sensor_option, "--no-video"
    )
    assert (result.exit_code, expected in result.output) == (2, True), result.output


@pytest.mark.usefixtures("folder")
def test_a_sensor_that_lacks_an_attribute_is_refused_before_the_flight() -> None:
    Path("mynav.py").write_text(SENSOR.format(value="0").replace("stream = 20", ""))
    sensor_option = ["--set", "sensors.custom=[{sensor='mynav:Sensor'}]"]
    result = command("check", "T5", *sensor_option)
    assert (result.exit_code, "sensor Sensor (mynav.py) has no stream" in result.output) == (
        2,
        True,
    )
