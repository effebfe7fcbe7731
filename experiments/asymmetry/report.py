"""The page of the pitch study, whose text is page.md.j2."""

from pathlib import Path
from typing import Any

from experiments.asymmetry.added_error import ComparedMission, Mission, judged, paired, removed_in_all
from experiments.asymmetry.conditions import SEED
from experiments.asymmetry.missions import QUICK
from experiments.asymmetry.missions_page import Results, on_missions
from experiments.asymmetry.question_page import on_map, one_message
from experiments.asymmetry.remedies import EXACT, STEADIED
from experiments.asymmetry.remedies_page import in_words, remedies, shortfalls
from experiments.asymmetry.tables import gate_table, planner_table
from experiments.campaign.version import code_version
from experiments.pages.page import Film, write
from experiments.pages.template import page_of

_FILM = (
    "Following sea: the leader pitches. One estimate assumes a level leader, the other uses the pitch that the "
    "leader's AHRS measures."
)


def answer(missions: dict[Mission, ComparedMission]) -> dict[str, Any]:
    """Values of the page's summary: the mission to which pitch adds most, and what attitude broadcast removes."""
    chosen = judged(missions, "laisn-2")
    if not chosen:
        return {"worst": None, "judged": 0, "exact": "", "steadied": ""}
    exact, steadied = (in_words(removed_in_all(chosen, arm)) for arm in (EXACT, STEADIED))
    worst = max(chosen, key=lambda e: e.part)
    return {"worst": worst, "judged": len(chosen), "exact": exact, "steadied": steadied}


def write_report(results: Results, path: Path) -> None:
    """Write the page; the same results give the same bytes."""
    missions = paired(results.missions)
    facts = [
        ("conditions", str(len(results.conditions))),
        ("missions", f"{len({(r.condition, r.route, r.depth_offset_m) for r in results.missions})}"),
        ("runs", f"{sum(r.runs for r in results.missions):,} of {results.plan.duration_s:g} s"),
        ("seed", str(SEED)),
        ("version", code_version()),
        ("repeat with", f"laisn asymmetry{' --quick' if results.plan == QUICK else ''}"),
    ]
    values = {
        "film": [Film(path=results.film, caption=_FILM)] if results.film else [],
        "planner": [planner_table(reach, bound) for reach in (40.0, 100.0) for bound in (0.5, 1.0)],
        "gates": gate_table(results.gates),
        **answer(missions),
        **one_message(results.example),
        **on_map(results.chart),
        **on_missions(results, missions),
        **remedies(missions, results.plan),
        **shortfalls(missions, results.plan),
    }
    write(page_of("experiments.asymmetry", facts, values), path)
