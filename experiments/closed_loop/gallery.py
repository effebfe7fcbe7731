"""The picture of followers that steer by their own estimates."""

import numpy as np
from matplotlib.figure import Figure

from experiments.closed_loop.study import steering
from experiments.flight.fly import fly
from experiments.flight.library import ROUTES
from experiments.pages.figures import Line, panel
from experiments.pages.style import SERIES, Colour


def picture() -> tuple[Figure, list[tuple[Colour, str]]]:
    """How a mirrored estimate leads a follower away: true and believed distances from the leader's axis."""
    lines = []
    for navigator, colour in (("laisn-2", SERIES[1]), ("laisn-3-2", SERIES[0])):
        mission = steering(0, navigator, "estimate")
        chosen = (mission.followers[ROUTES.index("T5")],)
        flight, _ = fly(mission.model_copy(update={"followers": chosen, "duration_s": 140.0}))
        steps = flight.step_index()
        heading, leader = flight.trajectory.heading[steps, 0], flight.trajectory.position[steps, 0, :2]
        starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
        for position, dash in ((flight.hydrophone(0)[:, :2], "-"), (flight.estimates[0].state[:, :2], ":")):
            aside = np.einsum("ni,ni->n", position - leader, starboard)
            lines.append(Line(x=flight.trajectory.time[steps], y=aside, colour=colour, dash=dash, width=1.4))
    figure = panel(lines, x_label="time [s]", y_label="to starboard of the leader's axis [m]", height=3.0)
    return figure, [
        (SERIES[1], "LAISN-2: steers by the dotted estimate, swims along the line"),
        (SERIES[0], "LAISN-3(2): both stay within a few metres of it"),
    ]
