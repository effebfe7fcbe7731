"""A copy of the working tree in which tests meet faults."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from experiments.gallery import house
from experiments.gallery.house import ROOT
from tests.mutants.cover import covering
from tests.mutants.faults import Mutant


class Copy:
    """A copy of the working tree in which mutants are tried, one after the other."""

    def __init__(self, folder: Path, kept: Path) -> None:
        """Copy the files that git knows or would take, each source with a comment more.

        Tests thereby meet sources that read otherwise and mean the same, and those that mind are found out.

        Args:
            folder: to be made.
            kept: cache of compiled code, which copies may share.
        """
        self._tree, self._trial, self._kept = folder / "tree", folder / "cache", kept
        self._written = 0
        git = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        for name in subprocess.run(git, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0"):
            if name and (ROOT / name).is_file():
                (self._tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, self._tree / name)
        for path in house.modules().values():
            self._write(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8") + "# as it is\n")

    def _write(self, file: str, text: str) -> None:
        """Write a source with a time of its own: Python takes it for unchanged where second and size are the same."""
        (self._tree / file).write_text(text, encoding="utf-8")
        self._written += 1
        os.utime(self._tree / file, (self._written, self._written))

    def _run(self, tests: Iterable[str], cache: Path, limit: float | None = None) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", "--tb=short", *tests]
        environment = os.environ | {"PYTHONPATH": str(self._tree), "XDG_CACHE_HOME": str(cache)}
        return subprocess.run(
            [*command, "--hypothesis-profile", "mutants"],
            cwd=self._tree, env=environment, capture_output=True, text=True, timeout=limit,
        )  # fmt: skip

    def control(self, test: str) -> str:
        """What a test file says that fails without any mutant, else nothing; code that it compiles is kept."""
        done = self._run([test], self._kept)
        return done.stdout if done.returncode else ""

    def notices(self, mutant: Mutant, limit: float) -> bool:
        """Whether a test fails, or they do not end within a limit [s]."""
        tests, whole = covering(mutant.file), (self._tree / mutant.file).read_text(encoding="utf-8")
        if not tests:
            return False
        # files of a cache are replaced, never written to: links will do
        shutil.copytree(self._kept, self._trial, copy_function=os.link)
        self._write(mutant.file, mutant.text())
        try:
            return self._run(tests, self._trial, limit).returncode != 0
        except subprocess.TimeoutExpired:
            return True
        finally:
            self._write(mutant.file, whole)
            shutil.rmtree(self._trial)
