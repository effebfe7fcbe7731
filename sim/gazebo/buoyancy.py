"""The water of a file: its density, and the links to which the world gives buoyancy."""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

from laisn.errors import LaisnError
from sim.gazebo.document import Parameters, Remarks, child_number, numbers, plugins_of
from sim.gazebo.frames import SdfModel
from sim.water.waves import GRAVITY

DEFAULT_DENSITY = 1000.0  # of gz-sim's Buoyancy [kg/m³]
SDF_GRAVITY = 9.8  # of a world that states none [m/s²]
MIN_DENSITY = 1.0  # least density that is a fluid's, as of air [kg/m³]
MAX_DENSITY = 2e4  # largest one, beyond that of mercury


@dataclass(frozen=True)
class FileWater:
    """The water in which a file's model swims."""

    density: float  # [kg/m³]
    source: str  # where the density is from, for comments and errors
    enabled: frozenset[str] = frozenset()  # names of models and links with buoyancy; empty: all

    def __post_init__(self) -> None:
        """LaisnError if the density is none of a fluid."""
        if not MIN_DENSITY <= self.density <= MAX_DENSITY:
            raise LaisnError(
                f"{self.source}: expected a density from {MIN_DENSITY:g} to {MAX_DENSITY:g} kg/m³ "
                f"(given: {self.density:g})"
            )

    def displaces(self, model: SdfModel, link: str) -> bool:
        """Whether a link has buoyancy."""
        path = model.path()
        outer = {"::".join(path[: i + 1]) for i in range(len(path))}
        return not self.enabled or bool(self.enabled & (outer | {"::".join([*path, link])}))


def water_of(root: Element, model: SdfModel, remarks: Remarks) -> FileWater:
    """Density by the world's Buoyancy plugin, else by <water_density> of Hydrodynamics, else that
    of gz-sim.
    """
    for world in root.findall("world"):
        gravity = world.find("gravity")
        if gravity is not None:
            acceleration = float(-numbers(gravity.text, 3, "<gravity>")[2])
            if abs(acceleration - GRAVITY) > abs(SDF_GRAVITY - GRAVITY) + 1e-6:
                remarks.add(f"<gravity> of {acceleration:g} m/s² is not used: {GRAVITY:g} m/s²")
        for plugin in plugins_of(world, "Buoyancy"):
            return _water_of_plugin(plugin, remarks)
    for scope in model.all_models():
        for plugin in plugins_of(scope.element, "Hydrodynamics"):
            for tag in ("water_density", "waterDensity"):
                if plugin.find(tag) is not None:
                    density = child_number(plugin, tag, DEFAULT_DENSITY)
                    return FileWater(density, f"<{tag}> of Hydrodynamics")
    remarks.add(
        "the file has no world with a Buoyancy plugin: its water has that plugin's default, "
        f"{DEFAULT_DENSITY:g} kg/m³"
    )
    return FileWater(DEFAULT_DENSITY, "default of Gazebo's Buoyancy")


def _water_of_plugin(plugin: Element, remarks: Remarks) -> FileWater:
    parameters = Parameters(plugin, "Buoyancy", remarks, repeated=("enable",))
    density = DEFAULT_DENSITY
    source = "Buoyancy, default"
    graded = plugin.find("graded_buoyancy")
    parameters.text("graded_buoyancy")
    if "uniform_fluid_density" in parameters:
        density = parameters.number("uniform_fluid_density", DEFAULT_DENSITY)
        source = "uniform_fluid_density"
        if graded is not None:
            parameters.set_aside(["graded_buoyancy"], "the density is uniform")
    elif graded is not None:
        density = child_number(graded, "default_density", DEFAULT_DENSITY)
        source = "default_density"
        for change in graded.findall("density_change"):
            lowest = child_number(change, "above_depth", 0.0)
            layer_density = child_number(change, "density", 0.0)
            remarks.add(
                f"Buoyancy: density of {layer_density:g} kg/m³ above z = {lowest:g} m is not used, "
                f"the water has {density:g} kg/m³ up to its surface"
            )
    parameters.text("enable")
    parameters.remark_unused()
    enabled = frozenset((element.text or "").strip() for element in plugin.findall("enable"))
    return FileWater(density, f"{source} of the world's Buoyancy", enabled)
