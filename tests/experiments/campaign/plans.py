"""Small campaigns that tests compute."""

from experiments.campaign import campaign
from experiments.campaign.plans import CellPlan
from sim.scenario.settings import Follower, Navigation, Scenario, Timing

DURATION = 60.0


def scenario(route="T5", variant="laisn-2", interval=1.0, **changes):
    """A minute of kinematic motion with a message each `interval` [s]; `changes` are fields."""
    return Scenario(
        name=route,
        motion="kinematic",
        duration_s=DURATION,
        timing=Timing(message_interval_s=interval),
        followers=(Follower(route=route, depth_m=8.0),),
        navigation=Navigation(variant=variant),
        **changes,
    )


def plans(runs=5, **changes):
    """Cells of two routes, two variants and two message intervals: 8 cells of 2 motions."""
    return [
        CellPlan(scenario=scenario(route, variant, interval), runs=runs, **changes)
        for route in ("T3", "T5")
        for variant in ("laisn-2", "laisn-3-2")
        for interval in (1.0, 5.0)
    ]


def run(plans, folder, **options):
    """Compute cells into a folder; the row of each, in their order."""
    results = campaign.fly(plans, {}, folder, **options)
    return [results.cell(plan)[0] for plan in plans]


def contents(folder):
    """The bytes of all files of a folder, by their paths within it."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
