"""What the command is called with, and what a flight's folder holds."""

import re
import subprocess
import sys
from pathlib import Path

SHORT = ["--set", "duration_s=20", "--no-video"]
"""Options of a flight of 20 s that is not filmed."""
WITHOUT_FILM = {
    "flight.mcap",
    "report.html",
    "summary.json",
    "timing.json",
    "scenario.toml",
    "foxglove.json",
}
"""Files of a flight's folder, without the film."""


def laisn(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command with these arguments in a process of its own, in the folder `cwd`."""
    command = [sys.executable, "-m", "laisn_sim.cli.main", *arguments]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False
    )


def files(folder: Path) -> dict[str, bytes]:
    """Contents of all files in a folder, by their paths in it."""
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
