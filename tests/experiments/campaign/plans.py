"""Small campaigns to compute."""

from experiments.campaign import campaign
from experiments.campaign.plans import CellPlan
from sim.scenario.settings import Follower, Navigation, Scenario, Timing

DURATION = 60.0


def scenario(route="T5", variant="laisn-2", interval=1.0, **changes):
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
    return [
        CellPlan(scenario=scenario(route, variant, interval), runs=runs, **changes)
        for route in ("T3", "T5")
        for variant in ("laisn-2", "laisn-3-2")
        for interval in (1.0, 5.0)
    ]


def run(plans, folder, **how):
    """The rows of cells alone."""
    flown = campaign.fly(plans, {}, folder, **how)
    return [flown.cell(plan)[0] for plan in plans]


def contents(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }
