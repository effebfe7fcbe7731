"""What bent rays do to ranges and to fixes without noise, which needs no flights: `python -m
tools.documents.studies bending`.
"""

from pathlib import Path

from experiments.studies.thermocline.findings import SPOILT_SHIFT_M, fix_findings
from reports.findings import RESULTS_FILE, plain_finding, record

COMMAND = "python -m tools.documents.studies bending"
MODULES = ("tools.documents.bending",)


def run(folder: Path) -> None:
    """Trace all rays and write the record into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    matters = plain_finding(SPOILT_SHIFT_M, "shift of a fix that spoils it", "m")
    findings = {"matters": matters} | dict(fix_findings())
    record("bending", COMMAND, MODULES, findings).write(folder / RESULTS_FILE)
