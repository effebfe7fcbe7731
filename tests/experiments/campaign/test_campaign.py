"""Campaigns: the same bytes for any workers and interruptions, and no loss after an error."""

import itertools
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial
from zipfile import ZipFile

import numpy as np
import pytest

from experiments.campaign import campaign, montecarlo, store
from experiments.campaign.plans import CellPlan
from experiments.campaign.pool import Pool
from experiments.campaign.store import DamagedResult
from laisn import metrics
from laisn.navigator import Navigator
from reports.version import ROOT
from sim.flight import navigate
from tests.experiments.campaign.plans import DURATION, contents, plans, run, scenario


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """The folder of a campaign that one process computed, and its rows."""
    folder = tmp_path_factory.mktemp("campaign") / "whole"
    rows = run(plans(), folder, workers=1, quiet=True)
    return folder, rows


@pytest.mark.system
@pytest.mark.parametrize(("quiet", "compiled"), [(False, ["2.0 1"]), (True, [])])
def test_what_processes_need_is_compiled_before_they_are_timed(
    tmp_path, monkeypatch, quiet, compiled
):
    """A child process first computes the smallest campaign that there is, two messages and one
    run, so that the compiler's memory goes with it; not where no progress is shown.

    The file has a line for each call of `compute`: duration [s], runs, and "here" in the parent.
    """
    calls_file, compute = tmp_path / "calls", campaign.compute

    def note(trajectory, plans):
        with calls_file.open("a") as file:
            for plan in plans:
                file.write(
                    f"{trajectory.time[-1]} {plan.runs}{' here' if os.getpid() == parent else ''}\n"
                )
        return compute(trajectory, plans)

    parent = os.getpid()
    monkeypatch.setattr(campaign, "compute", note)
    run(plans()[:1], tmp_path / "out", workers=1, quiet=quiet)
    assert calls_file.read_text().splitlines() == [*compiled, f"{DURATION} 5 here"]


def meet(folder, name, others):
    """Note the process that this part runs in, and wait until so many others have come."""
    (folder / f"{name} {os.getpid()}").touch()
    ends = time.monotonic() + 30.0
    while len([*folder.iterdir()]) <= others:
        assert time.monotonic() < ends
        time.sleep(0.01)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_parts_are_compiled_side_by_side_in_processes_of_their_own(tmp_path, workers):
    """Two parts: each of two processes begins one before the other has ended."""
    processes = min(workers, 2)
    parts = [partial(meet, tmp_path, name, processes - 1) for name in ("first", "second")]
    campaign._compile_in_processes(parts, workers)
    numbers = {path.name.split()[1] for path in tmp_path.iterdir()}
    assert len([*tmp_path.iterdir()]) == 2
    assert len(numbers) == processes
    assert str(os.getpid()) not in numbers


@pytest.mark.system
def test_two_workers_give_the_bytes_of_one(computed, tmp_path):
    folder, rows = computed
    assert run(plans(), tmp_path / "two", workers=2, quiet=True) == rows
    assert contents(tmp_path / "two") == contents(folder)


def test_large_cells_of_one_mission_share_a_process_and_give_the_same_bytes(tmp_path, monkeypatch):
    one_cell, calls, compute = plans()[:1], [], campaign.compute
    run(one_cell, tmp_path / "one", workers=1, quiet=True)

    def note(trajectory, plans):
        calls.extend((os.getpid(), plan.threads) for plan in plans)
        return compute(trajectory, plans)

    monkeypatch.setattr(campaign, "_MANY_RUNS", one_cell[0].runs)
    monkeypatch.setattr(campaign, "compute", note)
    run(one_cell, tmp_path / "threads", workers=2, quiet=True)
    assert calls == [(os.getpid(), 2)]
    assert contents(tmp_path / "threads") == contents(tmp_path / "one")


def test_of_many_missions_first_cells_are_computed_without_reading_the_mission(
    tmp_path, monkeypatch
):
    """Of six missions, each is flown in one job with its two cells, which have the bytes of cells
    that read their mission from the store.
    """
    many = [
        replace(plan, scenario=plan.scenario.model_copy(update={"duration_s": duration}))
        for duration in (20.0, 21.0, 22.0, 23.0, 24.0, 25.0)
        for plan in plans()[:2]
    ]
    for start in range(0, len(many), 2):
        run(many[start : start + 2], tmp_path / "few", workers=1, quiet=True)
    monkeypatch.setattr(campaign, "mission", lambda *_: pytest.fail("a mission was read"))
    rows = run(many, tmp_path / "many", workers=1, quiet=True)
    assert rows == run(many, tmp_path / "few", workers=1, quiet=True)
    assert contents(tmp_path / "many") == contents(tmp_path / "few")


def killed_at(moment: int, folder):
    """Compute a campaign and write its table in a fork of this process; the status in which it
    ends, as of `os.waitpid`.

    It is killed before or after the file operation with the number `moment` (two moments for each
    operation). If it reaches the end, its exit code is the number of moments.
    """
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1]
    moments = itertools.count()

    def kill_if_due():
        if next(moments) == moment:
            os.kill(os.getpid(), signal.SIGKILL)

    def interrupted(operation):
        def between_two_moments(*args, **kwargs):
            kill_if_due()
            result = operation(*args, **kwargs)
            kill_if_due()
            return result

        return between_two_moments

    os.fsync, os.replace = interrupted(os.fsync), interrupted(os.replace)
    ZipFile.writestr = interrupted(ZipFile.writestr)
    store.write_array = interrupted(store.write_array)
    rows = run(plans(), folder, workers=1, quiet=True)
    store.write_table(folder / "tables.parquet", store.columns_of(rows))
    os._exit(min(next(moments), 255))


@pytest.mark.system
def test_killed_at_any_of_30_moments_a_campaign_goes_on_and_gives_the_same_tables(
    computed, tmp_path
):
    _, rows = computed
    status = killed_at(-1, tmp_path / "whole")
    assert os.WIFEXITED(status)
    moments, whole = os.WEXITSTATUS(status), contents(tmp_path / "whole")
    assert moments >= 60
    for moment in np.linspace(0, moments - 2, 30).astype(int).tolist():
        broken = tmp_path / f"{moment}"
        assert os.WTERMSIG(killed_at(moment, broken)) == signal.SIGKILL
        complete_files = {
            name: content
            for name, content in contents(broken).items()
            if not name.endswith(".part")
        }
        # every file with its final name is complete
        assert complete_files.items() <= whole.items()
        assert os.WIFEXITED(killed_at(-1, broken))
        files = contents(broken)
        assert {name: files[name] for name in whole} == whole
    assert store.read_table(tmp_path / "whole" / "tables.parquet") == rows


# computes the plans, prints how many cells this process computed itself, and the rows
SHARED = """
import sys, time
from pathlib import Path
from experiments.campaign import campaign
from tests.experiments.campaign.plans import plans, run
computed, compute = [], campaign.compute

def counted(trajectory, plans):
    computed.extend(plan.key for plan in plans)
    time.sleep(float(sys.argv[2]))
    return compute(trajectory, plans)

campaign.compute = counted
print("ready", flush=True)
sys.stdin.readline()
rows = run(plans(), Path(sys.argv[1]), workers=1, quiet=True)
print(len(computed), repr(rows))
"""


@pytest.mark.system
def test_two_processes_in_one_folder_share_the_work_and_give_the_same_rows(computed, tmp_path):
    folder, rows = computed
    shared = tmp_path / "shared"
    children = [
        subprocess.Popen(
            [sys.executable, "-c", SHARED, str(shared), pause_s],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        # of equal speed, they might take each mission at the same time
        for pause_s in ("0.05", "0.3")
    ]
    for child in children:
        assert child.stdout.readline() == "ready\n"
    counts = []
    for child in children:
        child.stdin.write("go\n")
        child.stdin.flush()
    for child in children:
        printed, _ = child.communicate(timeout=120)
        count, _, actual = printed.partition(" ")
        counts.append(int(count))
        assert actual.strip() == repr(rows)
    # a process that starts late may find everything stored
    assert len(plans()) <= sum(counts) < 2 * len(plans())
    assert set(contents(shared)) == {
        name for name in contents(folder) if not name.endswith(".part")
    }


def test_what_is_stored_is_not_computed_again(computed, monkeypatch):
    folder, rows = computed
    monkeypatch.setattr(campaign, "compute", lambda *_: pytest.fail("computed again"))
    assert run(plans(), folder, workers=1, quiet=True) == rows


def test_force_computes_everything_again(computed, monkeypatch):
    folder, rows = computed
    computed_plans = []
    original = campaign.compute
    monkeypatch.setattr(
        campaign, "compute", lambda *args: computed_plans.extend(args[1]) or original(*args)
    )
    assert run(plans(), folder, workers=1, force=True, quiet=True) == rows
    assert len(computed_plans) == len(plans())


@pytest.mark.parametrize(
    "damage", [b"", b"PAR1 not a table", None], ids=["empty", "garbage", "one flipped byte"]
)
def test_a_damaged_cell_is_computed_again_with_a_warning(computed, damage):
    folder, rows = computed
    path = store.Store(folder).path(plans()[3].key)
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 4] ^= 0x40
    path.write_bytes(bytes(flipped) if damage is None else damage)
    with pytest.warns(DamagedResult, match="computed again"):
        assert run(plans(), folder, workers=1, quiet=True) == rows
    assert path.read_bytes() == whole


def test_a_cell_under_a_wrong_name_does_not_count(computed):
    folder, rows = computed
    first, second = (store.Store(folder).path(plans()[i].key) for i in (0, 1))
    whole = second.read_bytes()
    second.write_bytes(first.read_bytes())
    with pytest.warns(DamagedResult, match="another result"):
        assert run(plans(), folder, workers=1, quiet=True) == rows
    assert second.read_bytes() == whole


def test_results_of_another_version_are_refused_and_kept(tmp_path):
    other = tmp_path / "other"
    run(plans()[:1], other, workers=1, quiet=True)
    (other / "campaign.json").write_text('{"version": "0.0.9+old"}')
    before = contents(other)
    with pytest.raises(ValueError, match=r"version 0\.0\.9\+old.*--out.*--force"):
        run(plans()[:1], other, workers=1, quiet=True)
    assert contents(other) == before


def test_no_runs_or_workers_are_refused():
    with pytest.raises(ValueError, match="runs is 0, expected at least 1"):
        CellPlan(scenario=scenario(), runs=0)
    with pytest.raises(ValueError, match="workers is 0"):
        Pool(0)
    with pytest.raises(ValueError, match="follower is 1, the scenario has 1"):
        CellPlan(scenario=scenario(), follower=1)


# a Dask worker on which this project cannot be imported
BARE_WORKER = """
import asyncio, sys

class Hidden:
    def find_spec(self, name, path, target=None):
        if name.split(".")[0] in ("experiments", "reports"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Hidden())
from distributed import Worker

async def work():
    async with Worker(sys.argv[1], dashboard=False, name="bare") as worker:
        await worker.finished()

asyncio.run(work())
"""


@pytest.mark.system
def test_a_cluster_gives_the_same_bytes_and_bare_workers_are_refused_at_once(computed, tmp_path):
    distributed = pytest.importorskip("distributed")
    folder, rows = computed
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=2,
        processes=False,
        dashboard_address=None,
        protocol="tcp://",
    ) as cluster:
        address = cluster.scheduler_address
        assert run(plans(), tmp_path / "cluster", cluster=address, quiet=True) == rows
        assert contents(tmp_path / "cluster") == contents(folder)
        bare_worker = subprocess.Popen(
            [sys.executable, "-c", BARE_WORKER, address], stderr=subprocess.DEVNULL
        )
        try:
            with distributed.Client(address) as client:
                client.wait_for_workers(2, timeout=60)
            begun = time.monotonic()
            with pytest.raises(ValueError, match=r"is not installed on these workers of tcp://"):
                run(plans(), tmp_path / "refused", cluster=address, quiet=True)
            assert time.monotonic() - begun < 10
        finally:
            bare_worker.kill()
            bare_worker.wait()


@pytest.mark.system
def test_a_cluster_that_loses_a_worker_gives_the_same_rows(computed, tmp_path):
    distributed = pytest.importorskip("distributed")
    _, rows = computed
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, protocol="tcp://"
    ) as cluster:
        victim = next(iter(cluster.workers.values())).pid

        cell_files = [store.Store(tmp_path / "lost").path(plan.key) for plan in plans()]

        def kill_after_the_first_cell():
            deadline = time.monotonic() + 120
            while time.monotonic() < deadline and not any(path.is_file() for path in cell_files):
                time.sleep(0.01)
            os.kill(victim, signal.SIGKILL)

        killer = threading.Thread(target=kill_after_the_first_cell)
        killer.start()
        rows_after_loss = run(
            plans(), tmp_path / "lost", cluster=cluster.scheduler_address, quiet=True
        )
        killer.join()
    assert rows_after_loss == rows


def test_no_more_processes_start_than_there_are_tasks(tmp_path, monkeypatch):
    sizes = []

    class Counted(Pool):
        """A pool of one process that keeps how many there would have been."""

        def __enter__(self):
            sizes.append(self.size)
            self.size = 1
            return super().__enter__()

    monkeypatch.setattr(campaign, "Pool", Counted)
    three = plans()[:3]
    run(three, tmp_path, workers=64, quiet=True)
    run(three, tmp_path, workers=64, quiet=True)
    run(plans(), tmp_path, workers=2, quiet=True)
    # one process for each cell, one if nothing is missing, and no more than were asked for
    assert sizes == [3, 1, 2]


def test_a_single_flight_has_the_noise_of_its_run(computed):
    _, rows = computed
    row = rows[0]
    worst_scenario = plans()[0].scenario.model_copy(update={"run": row["worst_run"]})
    flight = navigate(worst_scenario, montecarlo.simulate_mission(worst_scenario), Navigator)
    error = metrics.position_errors(flight.estimates[0].state[:, :2], flight.hydrophone(0)[:, :2])
    assert error.max() == pytest.approx(row["e_p_max_m"], abs=1e-7)


def test_errors_at_each_step_agree_with_the_summary(tmp_path):
    plan = CellPlan(scenario=scenario(), runs=7, keep_steps=True)
    [row] = run([plan], tmp_path, workers=1, quiet=True)
    _, steps = store.Store(tmp_path).get(plan.steps_key)
    assert steps["e_p_max_m"].max() == pytest.approx(row["e_p_max_m"], rel=1e-6)
    assert steps["e_p_mean_m"].astype(float).mean() == pytest.approx(row["e_p_mean_m"], rel=1e-6)
    assert steps["e_b_mean_deg"].astype(float).mean() == pytest.approx(
        row["e_b_mean_deg"], rel=1e-5
    )
    assert len(steps["time_s"]) == row["steps"] == round(DURATION / 0.1)
    assert steps["e_b_max_deg"].max() == pytest.approx(row["e_b_max_deg"], rel=1e-5)
    trajectory = campaign.mission(plan.scenario, store.Store(tmp_path))
    hydrophone = trajectory.site_path(f"{trajectory.names[1]}/hydrophone")[1:]
    east, north, _ = (hydrophone - trajectory.position[1:, 0]).T
    assert steps["distance_m"] == pytest.approx(np.hypot(east, north), rel=1e-5)
    bearing_from_north = np.deg2rad(steps["bearing_deg"].astype(float)) + trajectory.heading[1:, 0]
    assert (
        np.abs(np.exp(1j * bearing_from_north) - (north + 1j * east) / np.hypot(east, north)).max()
        < 1e-5
    )
    assert 0 <= steps["bearing_deg"].min() <= steps["bearing_deg"].max() < 360
    assert steps["speed_m_s"] == pytest.approx(trajectory.forward_speed[1:, 1], rel=1e-5)


def test_steps_requested_later_are_added(computed, tmp_path):
    whole, rows = computed
    folder = shutil.copytree(whole, tmp_path / "copy")
    with_steps = [replace(plan, keep_steps=True) for plan in plans()]
    assert run(with_steps, folder, workers=1, quiet=True) == rows
    assert store.Store(folder).get(with_steps[0].steps_key) is not None


def test_the_key_depends_on_what_a_cell_is_computed_from_and_on_nothing_else():
    plan = CellPlan(scenario=scenario())
    assert (
        plan.key
        == CellPlan(scenario=scenario().model_copy(update={"name": "renamed", "run": 7})).key
    )
    others = [
        CellPlan(scenario=scenario(), runs=61),
        CellPlan(scenario=scenario(seed=2)),
        CellPlan(scenario=scenario(interval=5.0)),
        CellPlan(scenario=scenario(variant="laisn-3-1")),
    ]
    assert len({plan.key, *(other.key for other in others)}) == 5
