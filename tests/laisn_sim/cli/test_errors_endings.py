"""Ends of the command: no process and no partial file is left, and a signal shows no traceback."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from reports.version import ROOT
from tests.laisn_sim.cli.flights import without_notice

pytestmark = pytest.mark.system

LAISN = [sys.executable, "-c", "from laisn_sim import main; main()"]
WITHOUT_REPORT = """
import sys, types

# to draw one takes a second, and it is not checked here
module = types.ModuleType("reports.flight_report")
module.flight_report = lambda flight, errors, summary, path, *_: path.write_text("")
sys.modules[module.__name__] = module
from laisn_sim import main
main()
"""
FLY = [
    sys.executable,
    "-c",
    WITHOUT_REPORT,
    "fly",
    "T5",
    "--set",
    "duration_s=2",
    "--no-video",
    "--out",
]


def has_ended(pid: int) -> bool:
    """Whether a process has ended, reaped or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except FileNotFoundError:
        return True


def have_all_ended(pids: list[int], seconds: float = 10.0) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and not all(has_ended(pid) for pid in pids):
        time.sleep(0.05)
    return all(has_ended(pid) for pid in pids)


POOL_SCRIPT = """
import os, sys, time
from experiments.campaign.pool import Pool

def work(number):
    # in one piece: the other worker writes at the same time
    os.write(1, f"{os.getpid()}\\n".encode())
    time.sleep(60)

if __name__ == "__main__":
    from laisn_sim.cli import errors
    errors.handle_signals()
    with Pool(2) as pool:
        list(pool.each(work, [(1,), (2,)]))
"""


@pytest.mark.parametrize("sent_signal", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_the_process_that_started_them(
    tmp_path: Path, sent_signal: signal.Signals
) -> None:
    script = tmp_path / "script.py"
    script.write_text(POOL_SCRIPT)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    # a test that was started in the background ignores Ctrl-C, and so would its children
    parent = subprocess.Popen(
        [sys.executable, str(script)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert parent.stdout is not None
    with parent:
        workers = [int(parent.stdout.readline()) for _ in range(2)]
        assert not any(has_ended(pid) for pid in workers)
        parent.send_signal(sent_signal)
        assert parent.wait(30) != 0
    assert have_all_ended(workers)


CHILD_SCRIPT = """
import os, subprocess, sys, time
code = (
        f"from sim.system import exit_with_parent; exit_with_parent({os.getpid()}); "
        "import time; time.sleep(60)"
    )
child = subprocess.Popen([sys.executable, "-c", code])
print(child.pid, flush=True)
time.sleep(60)
"""


def test_a_child_ends_with_a_parent_that_was_killed() -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", CHILD_SCRIPT], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert parent.stdout is not None
    with parent:
        child = int(parent.stdout.readline())
        parent.kill()
    assert have_all_ended([child])


@pytest.mark.parametrize("sent_signal", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_flight_like_ctrl_c(tmp_path: Path, sent_signal: signal.Signals) -> None:
    folder = tmp_path / "out"
    command = [*LAISN, "fly", "T5", "--no-video", "--out", str(folder)]
    # the parent of the tests may ignore it
    child = subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(sent_signal, signal.SIG_DFL),
    )
    while not list(folder.glob("unfinished")) and child.poll() is None:
        time.sleep(0.002)
    child.send_signal(sent_signal)
    _, reported = child.communicate(timeout=60)
    assert child.returncode == 128 + sent_signal
    assert reported == "laisn: interrupted; nothing of this flight is kept\n"
    assert not folder.exists()


INTERRUPT_WHILE_LOADING = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)

class Interrupting:
    def find_spec(self, name, path, target=None):
        if name == loaded:
            os.kill(os.getpid(), signal.SIGINT)

loaded = sys.argv[1]
sys.meta_path.insert(0, Interrupting())
sys.argv[0:2] = ["laisn"]
from laisn_sim import main
main()
"""


@pytest.mark.parametrize(
    "module", ["experiments", "typer", "laisn_sim.cli.errors", "numpy", "numba", "mujoco"]
)
def test_ctrl_c_while_modules_are_loaded_gives_no_traceback(tmp_path: Path, module: str) -> None:
    command = [
        sys.executable,
        "-c",
        INTERRUPT_WHILE_LOADING,
        module,
        *FLY[3:],
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stdout == ""
    assert done.stderr.startswith("laisn: interrupted")
    assert len(done.stderr.splitlines()) == 1


INTERRUPT_BEFORE_COMMAND = """
import os, signal, sys
import typer
from laisn_sim.cli.errors import run
signal.signal(signal.SIGINT, signal.default_int_handler)
app = typer.Typer()

@app.callback()
def every_command():
    os.kill(os.getpid(), signal.SIGINT)

@app.command()
def fly(): ...

sys.argv = ["laisn", "fly"]
run(app)
"""


def test_ctrl_c_before_a_command_begins_ends_it() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPT_BEFORE_COMMAND], cwd=ROOT, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


INTERRUPT_AT_EXIT = """
import atexit, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
sys.argv = ["laisn", "--version"]
from laisn_sim import main
main()
"""


def test_ctrl_c_at_the_very_end_kills_without_a_traceback() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPT_AT_EXIT], cwd=ROOT, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")
    assert done.stdout.startswith("laisn-sim ")


def test_the_end_of_a_command_searches_no_garbage() -> None:
    """Python's search at its end would take a tenth of a flight; few objects are left to search."""
    counting = "import atexit, gc; atexit.register(lambda: print(len(gc.get_objects())));"
    command = [sys.executable, "-c", f"{counting} from laisn_sim import main; main()", "--version"]
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    objects_left = int(ended.stdout.splitlines()[-1])
    assert objects_left < 1000


def test_a_poor_encoding_costs_letters_and_nothing_else(tmp_path: Path) -> None:
    """A letter that ASCII lacks, as × in `× bound`, is printed as a question mark."""
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [*FLY, str(tmp_path / "out")], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, without_notice(done.stderr)) == (0, "")
    assert "? bound" in done.stdout
    assert (tmp_path / "out" / "summary.json").exists()


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="this system has no device that is always full"
)
def test_a_full_disk_behind_standard_output_is_reported_and_costs_no_file(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*FLY, str(tmp_path / "out")], cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True
        )
        listed = subprocess.run(
            [*LAISN, "scenarios"], cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert (done.returncode, listed.returncode) == (2, 2)
    # where this test is the first to compile something, a notice is printed before
    assert (
        without_notice(done.stderr)
        == listed.stderr
        == "laisn: output: No space left on device; make room there, or choose another folder\n"
    )
    assert (tmp_path / "out" / "summary.json").exists()


def test_a_closed_standard_output_costs_no_file(tmp_path: Path) -> None:
    closed = subprocess.run(
        ["sh", "-c", '"$@" >&-', "sh", *FLY, str(tmp_path / "closed")], cwd=ROOT, check=False
    )
    assert closed.returncode == 0
    read, write = os.pipe()
    os.close(read)
    broken = subprocess.run(
        [*FLY, str(tmp_path / "pipe")], cwd=ROOT, stdout=write, stderr=subprocess.PIPE, text=True
    )
    os.close(write)
    assert (broken.returncode, without_notice(broken.stderr)) == (1, "")
    for name in ("closed", "pipe"):
        assert (tmp_path / name / "summary.json").exists()


STUDY = """
name = "mine"
question = "?"
scenario = "T5"
runs = 2000
[set]
motion = "kinematic"
[vary]
"followers.0.depth_m" = [10, 12, 14, 16, 18, 20]
"""


def test_ctrl_c_in_a_study_leaves_a_clean_state(tmp_path: Path) -> None:
    """No worker, no partial file, one line and exit code 130; what is stored is complete."""
    (tmp_path / "mine.toml").write_text(STUDY)
    command = [
        *LAISN,
        "study",
        str(tmp_path / "mine.toml"),
        "--out",
        str(tmp_path / "out"),
        "--workers",
        "2",
    ]
    child = subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while child.poll() is None and not list(tmp_path.glob("out/store/*.zip")):
        time.sleep(0.01)
    os.killpg(child.pid, signal.SIGINT)
    printed, reported = child.communicate(timeout=60)
    assert child.returncode == 130
    assert printed == ""
    lines = [
        line for line in reported.splitlines() if not re.match(r"missions: |cells: |compil", line)
    ]
    assert lines == ["laisn: interrupted; finished files are kept, none is half-written"]
    assert not [
        path for path in (tmp_path / "out").rglob("*") if path.suffix not in {".zip", ".json", ""}
    ]
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline and processes_of(child.pid):
        time.sleep(0.1)
    assert processes_of(child.pid) == []


def processes_of(session: int) -> list[int]:
    """Processes of a session that still run."""
    running = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, session_of_process = path.read_text().rpartition(")")[2].split()[:4]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if session_of_process == str(session) and state not in "ZX":
            running.append(int(path.parent.name))
    return running
