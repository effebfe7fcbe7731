"""The report of the pitch study, for someone who has not read the code."""

from collections.abc import Sequence
from pathlib import Path

from experiments.asymmetry.added_error import ComparedMission, Mission, judged, paired, removed_in_all
from experiments.asymmetry.conditions import SEED
from experiments.asymmetry.missions import QUICK
from experiments.asymmetry.missions_page import Results, on_missions, stage_4
from experiments.asymmetry.question_page import chart_section, one_message, question
from experiments.asymmetry.remedies import EXACT, STEADIED
from experiments.asymmetry.remedies_page import in_words, remedies, shortfalls
from experiments.asymmetry.tables import gate_table, planner_table
from experiments.campaign.version import code_version
from experiments.pages.page import Film, Page, Section, Text, write


def _limits() -> Section:
    return Section(
        title="Limits",
        blocks=[
            Text(
                text="All missions are those of one 2 m hull with one autopilot; how much another hull pitches must "
                "be measured on it, what a given pitch does need not. Followers keep a constant depth, so that "
                "their depth offset varies while the leader dives. Waves keep their compass direction: what comes "
                "from ahead on the leader's first leg comes from abeam on its second. Rays are straight, the sea "
                "surface and the floor mirror without loss. The AHRS is one of small MEMS units with gyros in "
                "balance; what is left of a gyro's bias acts as the constant error does. The follower routes fit the "
                "published ones; the originals were never published."
            ),
        ],
    )


def _summary(missions: dict[Mission, ComparedMission]) -> str:
    chosen = judged(missions, "laisn-2")
    if not chosen:
        return "In the conditions flown, pitch moves no fix by as much as a decimetre in the mean."
    worst = max(chosen, key=lambda e: e.part)
    exact, steadied = (in_words(removed_in_all(chosen, arm)) for arm in (EXACT, STEADIED))
    return (
        "A pitching leader turns its followers' fixes about itself, by Δz sin φ abeam and more toward its axis. On "
        f"{len(chosen)} missions that adds up to {worst.part:.1f} m to the mean error (route {worst.real.route}, "
        f"{worst.real.depth_offset_m:g} m below, {worst.real.pitch_rms_deg:.1f}° rms), because estimates are pushed "
        f"over the leader's axis. A leader that broadcasts its attitude takes that away: {exact} of it in sum if it "
        f"knows its attitude exactly, {steadied} with an inclinometer of 0.5° that gyros steady."
    )


def write_report(results: Results, path: Path) -> None:
    """Write the page; the same results give the same bytes."""
    missions = paired(results.missions)
    short = shortfalls(missions, results.plan)
    sections: Sequence[Section] = [
        question(),
        one_message(results.example),
        chart_section(results.chart),
        on_missions(results, missions),
        stage_4(results),
        remedies(missions, results.plan),
        *([Section(title="Where the remedy falls short", blocks=short)] if short else []),
        Section(
            title="Table for a planner",
            blocks=[
                Text(
                    text="If neither leader nor follower can be changed, the formation can. The pitch is the "
                    "largest that the leader reaches, not its mean."
                ),
                *(planner_table(reach, bound) for reach in (40.0, 100.0) for bound in (0.5, 1.0)),
            ],
        ),
        Section(
            title="Gross errors and the gate",
            blocks=[
                Text(
                    text="An echo taken for the ping is the gross error that the paper's gate is for. The two ways "
                    "to bound what a follower can have travelled since its last accepted fix: at its top speed, or "
                    "at its measured speed."
                ),
                gate_table(results.gates),
            ],
        ),
        _limits(),
    ]  # fmt: skip
    if results.film:
        caption = (
            "Following sea: the leader pitches. One estimate takes it for level, the other is told the pitch that the "
            "leader's AHRS measures."
        )
        film = Film(path=results.film, caption=caption)
        sections = [*sections[:2], Section(title="Film", blocks=[film]), *sections[2:]]
    facts = [
        ("conditions", str(len(results.conditions))),
        ("missions", f"{len({(r.condition, r.route, r.depth_offset_m) for r in results.missions})}"),
        ("flown runs", f"{sum(r.runs for r in results.missions):,} of {results.plan.duration_s:g} s"),
        ("seed", str(SEED)),
        ("version", code_version()),
        ("repeat with", f"laisn asymmetry{' --quick' if results.plan == QUICK else ''}"),
    ]
    write(Page(title="What a pitching leader does to its followers", summary=_summary(missions), facts=facts,
               sections=sections), path)  # fmt: skip
