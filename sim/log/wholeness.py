"""Whether what was read of a flight's log is what was written, by the proofs in it."""

from bisect import bisect_left
from pathlib import Path

from sim.log import wire
from sim.log.contents import Contents
from sim.log.file import LogError, faults
from sim.log.proof import Digests, is_core, proofs


def _digests(log: Contents, until_ns: int | None = None) -> Digests:
    """Digests of what was read, up to some time."""
    digests = Digests()
    for name, data in log.attachments.items():
        digests.add_attachment(name, data)
    for name, facts in log.metadata.items():
        digests.add_metadata(name, facts)
    for topic, messages in log.topics.items():
        if is_core(topic):
            digests.add_channel(topic, messages.encoding, messages.schema)
            proved = messages if until_ns is None else messages.before(until_ns)
            for part in proved.parts():
                digests.add_framed(topic, wire.framed(proved.time_ns[part], *proved.stretch(part)).data)
    return digests


def _changed(path: Path, names: list[str], missing_s: float) -> LogError:
    what = f"the first {missing_s:g} s of its mission are missing" if missing_s > 0 else f"{', '.join(names)} changed"
    return LogError(f"{path}: is not what was written: {what}; use the file as the simulator wrote it")


def prove(path: Path, log: Contents) -> bool | None:
    """Check the log of a flight against its proofs; of one that was cut off later, keep what they still prove.

    Args:
        path: for messages.
        log: what was read of it; any channels, each of them as a whole. What is not proved is removed.

    Returns:
        Whether it is whole; None if nothing in it claims to prove anything.

    Raises:
        LogError: messages, attachments or metadata were changed, removed, added or reordered.
    """
    with faults(path):
        known = proofs(log.metadata.items())
    core = [messages for topic, messages in log.topics.items() if is_core(topic) and messages.time_ns.size]
    if not known or not core:
        return None
    last, missing_s = known[-1], (min(int(m.time_ns[0]) for m in core) - known[0].until_ns) / 1e9
    end = max(int(messages.time_ns[-1]) for messages in core)
    names = last.differing(_digests(log))
    if last.outcome and not names:
        return True
    reached = [proof for proof in known if proof.until_ns <= end and not proof.outcome]
    if not reached or (last.outcome and end + 1 >= last.until_ns):
        raise _changed(path, names, missing_s)
    names = reached[-1].differing(_digests(log, reached[-1].until_ns))
    if names:
        raise _changed(path, names, missing_s)
    log.keep_before(reached[-1].until_ns)
    return False


def strangers(path: Path, log: Contents) -> list[str]:
    """Attachments and metadata of a flight's log that are not what was written, as "attachment NAME" and so on."""
    with faults(path):
        known = proofs(log.metadata.items())
    if not known:
        return []
    first = known[0]
    return [name for name in first.differing(_digests(log, first.until_ns)) if not is_core(name)]


def proved_times(path: Path, log: Contents) -> list[int]:
    """Up to where messages since 1970 are proved, in order of time [ns]; empty for a log that is no flight's."""
    with faults(path):
        known = proofs(log.metadata.items())
    end = max((int(messages.time_ns[-1]) for messages in log.topics.values() if messages.time_ns.size), default=0)
    reached = [proof for proof in known if proof.until_ns <= end + 1]
    # digests go on: where one fits, all earlier ones do
    fits = bisect_left(reached, True, key=lambda proof: bool(proof.differing(_digests(log, proof.until_ns))))
    return [proof.until_ns for proof in reached[:fits]]
