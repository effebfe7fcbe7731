"""The picture of `docs/architecture.md`: packages in layers, drawn from the imports in the
sources.
"""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from reports.style import FRAME, INK, SERIES
from tools import import_graph

_WIDTH = 7.6
_HEIGHT = 8.2
_BOX = (0.9, 0.62)
"""Width and height of a package's box; boxes are a unit apart."""
_PARENTS = {"sim", "experiments"}
"""Packages of which those within are drawn in their place."""
_COLOURS = {
    "models": INK,
    "laisn": SERIES[2],
    "sim": SERIES[0],
    "reports": SERIES[4],
    "experiments": SERIES[1],
    "laisn_sim": SERIES[3],
}


def transitive_reduction(imports: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The imports between packages, without those that a path over other packages implies."""
    reach: dict[str, set[str]] = {}
    for package in sorted(imports, key=import_graph.layers(imports).__getitem__):
        reach[package] = set(imports[package]).union(
            *(reach[imported] for imported in imports[package])
        )
    return {
        package: {
            b for b in imported if not any(b in reach[other] for other in imported if other != b)
        }
        for package, imported in imports.items()
    }


def positions(imports: Mapping[str, set[str]]) -> dict[str, tuple[float, float]]:
    """Where each package is drawn: its layer upwards, and near the mean position of the packages
    that it imports; x and y of the middle of its box.
    """
    layer_of = import_graph.layers(imports)
    places_of: dict[str, tuple[float, float]] = {}
    max_count = max(list(layer_of.values()).count(layer) for layer in set(layer_of.values()))
    for layer in sorted(set(layer_of.values())):
        mean_x = {}  # of the packages that each imports
        for package in sorted(
            package for package, package_layer in layer_of.items() if package_layer == layer
        ):
            imported_x = [places_of[name][0] for name in imports[package]]
            mean_x[package] = sum(imported_x) / len(imported_x) if imported_x else max_count / 2
        start = (max_count - len(mean_x)) / 2
        places_of |= {
            name: (start + i, float(layer))
            for i, name in enumerate(sorted(mean_x, key=mean_x.__getitem__))
        }
    return places_of


def _draw_package(axes: Axes, package: str, position: tuple[float, float], count: int) -> None:
    """The box of a package of so many files."""
    x, y = position
    colour = _COLOURS[package.partition(".")[0]].light
    box_width, box_height = _BOX
    axes.add_patch(
        FancyBboxPatch(
            (x - box_width / 2, y - box_height / 2),
            box_width,
            box_height,
            boxstyle="round,pad=0,rounding_size=0.06",
            facecolor="white",
            edgecolor=colour,
            linewidth=1.0,
            zorder=2,
        )
    )
    name = package.rpartition(".")[2].replace("_", " ")
    files = "a file" if count == 1 else f"{count} files"
    axes.text(x, y + 0.08, name, ha="center", va="center", fontsize=6.4, color=colour, zorder=3)
    axes.text(
        x, y - 0.21, files, ha="center", va="center", fontsize=4.6, color=FRAME.light, zorder=3
    )


def _packages(imports: import_graph.Imports) -> dict[str, set[str]]:
    """The imports of each package that is drawn: `sim` and `experiments` by what is in them, the
    others as one.
    """
    package_imports: dict[str, set[str]] = {}
    for package, imported in import_graph.package_imports(imports).items():
        if package in _PARENTS:
            continue
        name = _drawn(package)
        package_imports[name] = package_imports.get(name, set()) | {
            _drawn(other) for other in imported - _PARENTS
        }
    return {name: imported - {name} for name, imported in package_imports.items()}


def _drawn(package: str) -> str:
    """The package in whose box one is drawn: itself, or `reports` or `laisn_sim` around it."""
    outermost = package.partition(".")[0]
    return outermost if outermost in ("reports", "laisn_sim") else package


def picture() -> Figure:
    """`laisn_sim` above `experiments`, `reports`, `sim`, and `laisn` and `models`; an arrow is an
    import, and all of them point down.
    """
    imports = import_graph.imports()
    package_imports = _packages(imports)
    places_of = positions(package_imports)
    figure = Figure(figsize=(_WIDTH, _HEIGHT))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    for package, imported in transitive_reduction(package_imports).items():
        for other in imported:
            x, y = places_of[package]
            u, v = places_of[other]
            axes.annotate(
                "",
                (u, v + _BOX[1] / 2),
                (x, y - _BOX[1] / 2),
                zorder=1,
                arrowprops={
                    "arrowstyle": "-|>",
                    "lw": 0.5,
                    "color": FRAME.light,
                    "mutation_scale": 5,
                    "shrinkA": 0,
                    "shrinkB": 0,
                    "alpha": 0.8,
                },
            )
    for package, position in places_of.items():
        count = sum(_drawn(import_graph.package_of(module)) == package for module in imports)
        # the __init__.py of a package within another does not count
        _draw_package(axes, package, position, max(1, count - ("." in package and count > 1)))
    columns, rows = zip(*places_of.values(), strict=True)
    axes.set_xlim(min(columns) - 0.6, max(columns) + 0.6)
    axes.set_ylim(min(rows) - 0.5, max(rows) + 0.5)
    return figure
