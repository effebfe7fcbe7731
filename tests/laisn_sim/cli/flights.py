"""What the command is called with, and what a flight's folder holds."""

import re
import subprocess
import sys
from pathlib import Path

SHORT = ["--set", "duration_s=20", "--no-video"]
WITHOUT_FILM = {
    "flight.mcap",
    "report.html",
    "summary.json",
    "timing.json",
    "scenario.toml",
    "foxglove.json",
}


def laisn(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "laisn_sim.cli.main", *arguments]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False
    )


def files(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


def without_notice(reported: str) -> str:
    """What a command wrote to standard error, without the lines on its progress that a log has
    after ten seconds, and on what it compiled.
    """
    notice = r"^(compil(ing|ed) \(once.*|[a-z ]+: \d+ %.*|preparing: \d+ s)\n"
    return re.sub(notice, "", reported, flags=re.MULTILINE)
