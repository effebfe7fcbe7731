"""The sample of LAISN-Bench in the repository, and its commands."""

import csv
from pathlib import Path

from typer.testing import CliRunner

from laisn_sim.cli.main import app

ROOT = Path(__file__).resolve().parents[3]
SAMPLE = ROOT / "examples" / "benchmark"


def laisn(*words: object, code: int = 0) -> str:
    """The output of a command, with single spaces in place of line breaks; the command must end
    with the exit code `code`.
    """
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return " ".join(result.output.split())


def scores_of(path: Path) -> list[dict[str, str]]:
    """Rows of the table that `laisn score --out` writes, one for each run of a mission."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))
