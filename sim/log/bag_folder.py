"""The folder that a ROS 2 bag is: what it may replace."""

from pathlib import Path

from sim.log.contents import LogError

METADATA = "metadata.yaml"
VIEW = "view.rviz"


def require_replaceable(folder: Path) -> None:
    """LogError if a bag would replace other things than an earlier bag."""
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise LogError(f"{folder}: is a file; a ROS 2 bag is a folder: give it another name")
    others = [
        path.name
        for path in sorted(folder.iterdir())
        if path.name not in (METADATA, VIEW) and path.suffix != ".mcap"
    ]
    if others:
        raise LogError(
            f"{folder}: holds {others[0]}, which is of no ROS 2 bag; give the bag a folder of its "
            "own"
        )
