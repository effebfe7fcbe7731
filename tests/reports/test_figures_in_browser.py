"""Figures as a browser draws them, and what a pointer does in them."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from reports.figures import Line, Panel, Subplot, panel
from reports.page import Figures, Page, PageSection, render
from tests import browser

pytestmark = pytest.mark.skipif(browser.executable() is None, reason="no Chromium is installed")
TIME = np.arange(0.0, 101.0)
HEATMAP: dict[str, Any] = {
    "type": "heatmap",
    "z": [[0.0, 1.0, 2.0], [3.0, None, 5.0]],
    "zmin": 0.0,
    "zmax": 5.0,
    "colorscale": [[0, "white"], [1, "black"]],
    "hovertext": [["a", "b", "c"], ["d", "", "f"]],
}


def over_time(scale: float) -> Panel:
    lines = [Line(x=TIME, y=scale * TIME, name="rises")]
    part = Subplot(lines=lines, y_label="E_P [m]", shaded=[(0.0, 10.0)])
    return Panel(parts=(part, part), x_label="time [s]", link="one", x_limits=(0.0, 100.0))


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Page]:
    heatmap = panel([], x_label="x", y_label="y", traces=[HEATMAP])
    panels = [over_time(2.0), over_time(3.0), heatmap]
    sections = [PageSection(title="figures", blocks=[Figures(panels=panels)])]
    path = tmp_path_factory.mktemp("figures") / "page.html"
    html = render(Page(title="T", summary="s", facts=[], sections=sections))
    path.write_text(html, encoding="utf-8")
    with browser.chromium() as page:
        page.open(path)
        page.wait("drawings.size === 3")
        page.run("window.all = [...drawings.values()]")
        yield page


def send_mouse_event(tab: browser.Page, kind: str, x: float, y: float, **more: Any) -> None:
    tab.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


def pixel_of_time(tab: browser.Page, figure: int, time: float) -> tuple[float, float]:
    """Point of a figure that has this time, in the window [px]."""
    left, top, _, height = tab.box(f"[data-figure='{figure}']")
    return left + tab.run(f"all[{figure}].x.at({time})"), top + 0.3 * height


def test_a_pointer_shows_values_and_its_time_in_linked_figures(tab: browser.Page) -> None:
    x, y = pixel_of_time(tab, 0, 40.0)
    send_mouse_event(tab, "mouseMoved", x, y)
    tab.wait("all[0].tip.style.display === 'block'")
    tip_lines = tab.run("all[0].tip.innerText").splitlines()
    assert tip_lines[0].startswith("time ")
    assert float(tip_lines[0].removeprefix("time ")) == pytest.approx(40.0, abs=0.5)
    assert tip_lines[1:] == ["▬ rises 80", "▬ rises 80"]
    linked = "new DOMMatrix(getComputedStyle(all[1].cursor).transform).e"
    tab.wait(f"Math.abs({linked} - all[1].x.at(40)) < 2")
    send_mouse_event(tab, "mouseMoved", 2.0, 2.0)
    tab.wait("all[0].tip.style.display === 'none'")


def test_a_drag_zooms_and_a_double_click_shows_all_again(tab: browser.Page) -> None:
    x, y = pixel_of_time(tab, 0, 20.0)
    end, _ = pixel_of_time(tab, 0, 60.0)
    send_mouse_event(tab, "mousePressed", x, y, button="left", clickCount=1)
    send_mouse_event(tab, "mouseMoved", end, y, button="left", buttons=1)
    send_mouse_event(tab, "mouseReleased", end, y, button="left", clickCount=1)
    assert tab.run("all[0].x.shown") == pytest.approx([20.0, 60.0], abs=1.0)
    for count in (1, 2):
        send_mouse_event(tab, "mousePressed", x, y, button="left", clickCount=count)
        send_mouse_event(tab, "mouseReleased", x, y, button="left", clickCount=count)
    tab.wait("all[0].x.shown[0] === 0")
    assert tab.run("all[0].x.shown") == [0, 100]


def test_a_map_of_colours_fills_its_axes_and_leaves_gaps(tab: browser.Page) -> None:
    assert tab.run("all[2].x.shown") == [-0.5, 2.5]
    assert tab.run("all[2].parts[0].axis.shown") == [-0.5, 1.5]
    cells = "all[2].box.querySelectorAll('g > rect')"
    fills = tab.run(f"[...{cells}].map((cell) => cell.style.fill)")
    assert len(fills) == 5
    assert "0%" in fills[0]
    assert tab.problems == []
