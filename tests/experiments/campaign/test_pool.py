"""Processes that compute: messages for a dead worker, a failed mission and a missing cluster."""

import os
import signal
import time

import pytest

from experiments.campaign import montecarlo, pool
from experiments.campaign.pool import Pool, release_workers
from experiments.campaign.store import CampaignError
from sim.scenario.settings import Follower, Scenario
from sim.vehicle.plant import PlantError

_ALLOCATED: list[bytearray] = []


def die(number):
    """Return the number; the process that gets 3 is killed."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.system
def test_a_dead_worker_is_reported_with_how_to_go_on():
    with Pool(2) as pool, pytest.raises(CampaignError, match="the same command goes on"):
        list(pool.each(die, ((i,) for i in range(8))))


def lost_flight(_):
    """Fly a mission whose simulation fails."""

    def lose_state(_):
        raise PlantError("t = 3 s: the state is lost")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(montecarlo, "simulate_open_loop", lose_state)
        return montecarlo.simulate_mission(Scenario(name="T6", followers=(Follower(route="T6"),)))


def allocate(megabytes: int) -> int:
    """Allocate memory that the process keeps, as a compiler does; the number of its calls."""
    _ALLOCATED.append(bytearray(b"x" * megabytes * 1_000_000))
    time.sleep(0.6)
    return len(_ALLOCATED)


@pytest.mark.long
def test_a_process_that_needs_much_memory_is_replaced_without_loss_and_without_a_warning(
    recwarn: pytest.WarningsRecorder,
) -> None:
    with Pool(2) as pool:
        call_numbers = [*pool.each(allocate, [(120,)] * 16)]
    release_workers()
    assert len(call_numbers) == 16
    # loky replaces a process that has grown by 300 MB; of 16 calls to two processes that stay, one
    # would have had 8 or more
    assert max(call_numbers) < 8
    assert not [str(warning.message) for warning in recwarn]


@pytest.mark.system
@pytest.mark.parametrize("workers", [1, 2])
def test_divergence_is_reported_from_any_process(workers):
    """The flight so far that such an error carries must not be taken for a death of the process."""
    with (
        Pool(workers) as pool,
        pytest.raises(CampaignError, match="mission 'T6': t = 3 s: the state is lost"),
    ):
        list(pool.each(lost_flight, [(1,)]))


@pytest.fixture
def impatient(monkeypatch):
    """A cluster has half a second to answer, in place of the few seconds that a user waits."""
    assert pool._CONNECT_S < 5
    monkeypatch.setattr(pool, "_CONNECT_S", 0.5)


@pytest.mark.usefixtures("impatient")
def test_a_missing_cluster_is_reported_at_once():
    start = time.monotonic()
    pool = Pool(1, "tcp://127.0.0.1:9")
    with pytest.raises(ValueError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        pool.__enter__()
    assert time.monotonic() - start < 10
