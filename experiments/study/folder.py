"""Studies from Python: `laisn_sim.study` and what it gives."""

from collections.abc import Mapping
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, Unpack

from experiments import findings
from experiments.campaign.campaign import ExecutionOptions
from experiments.findings import Finding
from experiments.flight.table import Table
from experiments.study.file import study_of
from experiments.study.study import RECORD, REPORT, RESULTS, RUNS, run_study
from laisn.failure import LaisnError


class StudyFolder:
    """What a study left in its folder: `results.parquet`, `runs.parquet`, `results.json` and `report.html`.

    Attributes:
        folder: of the study.
    """

    def __init__(self, folder: str | Path) -> None:
        """Take a folder that `laisn study` wrote; LaisnError if it has no results."""
        self.folder = Path(folder)
        if not (self.folder / RESULTS).is_file():
            raise LaisnError(f"{folder}: holds no results of a study ({RESULTS})")

    @property
    def report(self) -> Path:
        """The page of the study."""
        return self.folder / REPORT

    @cached_property
    def table(self) -> Table:
        """A row for each point, arm, sea and follower (`results.parquet`)."""
        return Table.read(self.folder / RESULTS)

    @cached_property
    def runs(self) -> Table:
        """A row for each run of these (`runs.parquet`)."""
        return Table.read(self.folder / RUNS)

    @property
    def findings(self) -> Mapping[str, Finding]:
        """The metric of the report at every point with its interval, and the differences of arms (`results.json`)."""
        return findings.read(self.folder / RECORD).findings

    def __repr__(self) -> str:
        return f"<StudyFolder in {self.folder}: {len(self.table)} rows, {len(self.runs)} runs>"

    def _repr_html_(self) -> str:
        report = escape(str(self.report), quote=True)
        return f'<p><a href="{report}">{report}</a></p>{self.table._repr_html_()}'


def run(
    source: str | Path | Mapping[str, Any],
    keys: Mapping[str, Any],
    out: str | Path | None,
    **options: Unpack[ExecutionOptions],
) -> StudyFolder:
    """Fly a study and give its results; arguments and errors as of `laisn_sim.study`."""
    study = study_of(source if isinstance(source, Mapping) else str(source), keys)
    folder = Path("out") / study.name if out is None else Path(out)
    run_study(study, folder, **(options | {"quiet": True}))
    return StudyFolder(folder)
