"""The pictures of README and docs: `make figures` writes `docs/pictures`. All that they show is
flown or computed here.

Works in a checkout only: the figures about physics are drawn from the very functions that the tests
judge.
"""

import tempfile
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

from experiments.flight.fly import fly
from experiments.flight.library import ROUTES, load_scenario
from experiments.studies.estimators import figures as estimators
from experiments.studies.thermocline import figures as thermocline
from experiments.study.file import built_in_files, study_of
from reports.figures import Line, Panel
from reports.flight_figures import error_parts
from reports.style import INK, SERIES, Legend
from sim.film import render
from sim.film.render import FilmJob
from sim.flight import FlightRecord, excerpt, position_and_bearing_errors
from sim.simulation import simulate_motion
from tools.documents import architecture, drawing, physics, route_keeping, study_pictures, terms
from tools.documents.markers import records

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "pictures"

WIDE = 7.0
"""Width of a picture that needs the width of its page [inch]."""

STILLS = {
    "mission": ("T8", 420.0, "chase"),
    "swarm": ("swarm", 530.0, "top"),
    "waves": ("following-sea", 200.0, "orbit"),
    "diving": ("diving", 75.0, "profile"),
}
"""Name of the picture: built-in scenario, mission time [s], camera."""

TURN_S = (455.0, 620.0)
"""When the formation goes round the leader's corner: the moving picture of the README [s]."""
FRAMES_HZ = 8  # of the moving picture


def save(figure: Figure, name: str, legend: Legend = ()) -> None:
    """Write a figure as SVG on white, its legend as coloured words above the axes on the right."""
    axes = figure.axes[0]
    for number, (colour, words) in enumerate(reversed(legend)):
        axes.annotate(
            words,
            (1.0, 1.0),
            xytext=(0, 5 + 10 * number),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right",
            fontsize=8,
            color=colour.light,
        )
    path = FOLDER / f"{name}.svg"
    with mpl.rc_context({"svg.hashsalt": "laisn-sim", "svg.fonttype": "none", "font.size": 8.5}):
        figure.set_canvas(FigureCanvasSVG(figure))
        figure.savefig(
            path,
            format="svg",
            metadata={"Date": None},
            facecolor="white",
            bbox_inches="tight",
            pad_inches=0.08,
        )
    text = path.read_text(encoding="utf-8")
    path.write_text(drawing.with_subscripts(text), encoding="utf-8")


def photograph(name: str, flight: FlightRecord, time: float, camera: str) -> None:
    """Write a still of a flight as JPEG."""
    video = flight.scenario.video.model_copy(
        update={"camera": camera, "width_px": 1280, "height_px": 720}
    )
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "still.png"
        render.still(FilmJob(flight=flight, video=video), time, picture)
        Image.open(picture).convert("RGB").save(
            FOLDER / f"{name}.jpg", quality=84, optimize=True, progressive=True
        )


def moving_picture(name: str, flight: FlightRecord, span: tuple[float, float]) -> None:
    """Write a stretch of a flight, seen from above, as an animated WebP of a few hundred pixels,
    for a README.
    """
    section = excerpt(flight, *span)
    video = section.scenario.video.model_copy(
        update={
            "camera": "top",
            "width_px": 640,
            "height_px": 360,
            "frame_rate_hz": FRAMES_HZ,
            "speed_up": 15.0,
        }
    )
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        render.render(FilmJob(flight=section, video=video), film)
        first, *others = frames(film)
    path = FOLDER / f"{name}.webp"
    step = round(1000 / FRAMES_HZ)
    first.save(
        path, save_all=True, append_images=others, duration=step, loop=0, quality=30, method=2
    )


def frames(film: Path) -> list[Image.Image]:
    """All pictures of a film."""
    import av

    with av.open(str(film)) as source:
        return [
            Image.fromarray(picture.to_ndarray(format="rgb24"))
            for picture in source.decode(video=0)
        ]


def routes() -> Figure:
    """The leader's L and the eight follower routes, as flown."""
    truth = simulate_motion(route_keeping.scenario())
    styles = [
        (INK, "-", 1.8),
        *((colour, "-", 1.0) for colour in SERIES),
        (SERIES[0], "--", 1.0),
        (SERIES[1], "--", 1.0),
    ]
    lines = [
        Line(
            x=truth.position[::5, v, 0],
            y=truth.position[::5, v, 1],
            colour=colour,
            dash=dash,
            width=width,
        )
        for v, (colour, dash, width) in enumerate(styles)
    ]
    figure = drawing.draw_lines(
        lines, x_label="east [m]", y_label="north [m]", equal_scales=True, height=4.0
    )
    for v, (name, (colour, dash, _)) in enumerate(zip(("leader", *ROUTES), styles, strict=True)):
        words = name if dash == "-" else f"{name}, dashed"
        figure.axes[0].annotate(
            words, (0.03, 0.93 - 0.06 * v), xycoords="axes fraction", color=colour.light
        )
    return figure


def errors(flight: FlightRecord) -> Figure:
    """E_P, E_B and B of a flight over time."""
    parts = error_parts(flight, 0, position_and_bearing_errors(flight)[0], None)
    return drawing.draw(Panel(parts=parts, x_label="time [s]", width=WIDE, height=4.1))


def main() -> None:
    """Write all pictures."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    save(architecture.picture(), "architecture")
    save(routes(), "routes")
    save(terms.picture(), "terms")
    save(terms.consistency(), "consistency")
    flights = {
        name: fly(load_scenario(name, ()))[0]
        for name in {"T5", *(scenario for scenario, _, _ in STILLS.values())}
    }
    save(errors(flights["T5"]), "errors")
    cases = study_of(str(built_in_files("estimators")["cases"]), {}).cases
    figures = physics.all_figures() | {
        "asymmetry": study_pictures.asymmetry(),
        "closed-loop": study_pictures.closed_loop(),
        "estimators": (
            drawing.draw(estimators.picture(records()["estimators"], cases)),
            estimators.LEGEND,
        ),
        "real-ranges": study_pictures.real_ranges(),
        "reproduction": study_pictures.reproduction(),
        "thermocline": (drawing.draw(thermocline.ray_picture("strong")), ()),
    }
    for name, (figure, legend) in figures.items():
        save(figure, name, legend)
    for name, (scenario, time, camera) in STILLS.items():
        photograph(name, flights[scenario], time, camera)
    moving_picture("turn", flights["swarm"], TURN_S)


if __name__ == "__main__":
    main()
