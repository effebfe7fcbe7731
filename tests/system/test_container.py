"""The image is built by the commands of the README; several processes make one study of a shared
folder, as jobs of an array do.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet
import pytest

pytestmark = pytest.mark.system
ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTAINERFILE = (ROOT / "Containerfile").read_text(encoding="utf-8")


def run_lines() -> list[str]:
    """Commands of the image, one a line."""
    joined = CONTAINERFILE.replace("\\\n", " ")
    return [line.removeprefix("RUN ") for line in joined.splitlines() if line.startswith("RUN ")]


def test_the_image_is_built_by_the_two_commands_of_the_readme() -> None:
    first_bash_block = re.search(r"^```bash\n(.*?)^```", README, flags=re.DOTALL | re.MULTILINE)
    assert first_bash_block is not None
    commands = [shlex.split(line, comments=True) for line in first_bash_block[1].splitlines()]
    assert commands == [["make", "run"], ["make", "test"]]
    lines = run_lines()
    assert lines[1:] == ["make run", 'if [ "$TESTS" = yes ]; then make test; fi']


def test_the_image_has_the_packages_that_the_readme_names() -> None:
    apt_command = re.search(r"`apt-get install ([^`]*)`", README)
    assert apt_command is not None
    installed = set(run_lines()[0].split())
    assert set(apt_command[1].split()) <= installed
    assert {"make", "python3", "python3-pip"} <= installed


def test_the_image_leaves_out_what_is_built_in_the_checkout() -> None:
    for name in (".containerignore", ".dockerignore"):
        ignored = (ROOT / name).read_text(encoding="utf-8").split()
        assert {".venv", "out", ".git"} <= set(ignored)


def start_study(folder: Path) -> subprocess.Popen[str]:
    """`laisn study` with one worker, as a job of an array runs it."""
    arguments = ["T5", "--vary", "followers.0.depth_m=10,12,14,16", "--runs", "4"]
    arguments += ["--set", "motion=kinematic", "--set", "duration_s=20", "--workers", "1"]
    return subprocess.Popen(
        [sys.executable, "-m", "laisn_sim.cli.main", "study", *arguments, "--out", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=folder.parent,
    )


@pytest.mark.system
def test_jobs_that_share_a_folder_make_one_study(tmp_path: Path) -> None:
    jobs = [start_study(tmp_path / "shared") for _ in range(2)]
    alone = start_study(tmp_path / "alone")
    for job in (*jobs, alone):
        output, _ = job.communicate(timeout=300)
        assert job.returncode == 0, output
    for name in ("results.parquet", "runs.parquet"):
        by_two_jobs, by_one_job = (
            pyarrow.parquet.read_table(tmp_path / folder / name) for folder in ("shared", "alone")
        )
        assert by_two_jobs.num_rows > 0
        assert by_two_jobs.equals(by_one_job)
    results = (tmp_path / "shared" / "results.json").read_bytes()
    assert results == (tmp_path / "alone" / "results.json").read_bytes()
    assert (tmp_path / "shared" / "report.html").exists()
