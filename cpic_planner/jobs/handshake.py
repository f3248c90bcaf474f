"""Workers say what they are before they do anything: those of other code, data or libraries are refused.

The client asks every worker of a given scheduler, at the start and when one joins. A worker that gets a task before it
was asked, as our own do, compares the fingerprints itself. Only the processor may differ.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from distributed import get_worker
from distributed.protocol.pickle import loads

from cpic_core import Fingerprint, InputError, differing_words, fingerprint, numeric_context
from cpic_planner.jobs.engine import ClusterError
from cpic_planner.version import __version__

_ANSWER_S = 20.0


class ForeignWorkerError(ClusterError):
    """A worker has other code, data or libraries than the client."""


@dataclass(frozen=True)
class Introduced:
    """The words in which a worker introduces itself."""

    version: str
    fingerprint: Fingerprint

    def differences(self) -> list[str]:
        """Say how it differs from this process, the processor apart, each in a few words."""
        other = fingerprint().differences(self.fingerprint)
        return other if self.version == __version__ else [f"version {self.version} (here {__version__})", *other]


def introduced() -> Introduced:
    """Return what this process is."""
    return Introduced(__version__, fingerprint())


def call(asked: str, load: bytes, common: tuple[Any, ...]) -> tuple[str, Any]:
    """Do a task that came as bytes, where this process is what the client is.

    Parameters
    ----------
    asked : str
        Fingerprint of the client.
    load : bytes
        Function and arguments, pickled.
    common : tuple
        Leading arguments.

    Returns
    -------
    tuple
        Fingerprint of this process, and what the task returned.

    Raises
    ------
    ForeignWorkerError
        If more than the processor differs.
    """
    function, args = unpacked(asked, load)
    with numeric_context():
        return str(fingerprint()), function(*common, *args)


def unpacked(asked: str, load: bytes) -> Any:
    """Return what came as bytes; parameters and errors are those of `call`."""
    if other := set(differing_words(asked, str(fingerprint()))) - {"processor"}:
        raise ForeignWorkerError(_foreign(get_worker().address, [f"other {word}" for word in sorted(other)]))
    return loads(load)


def refuse_foreign(client: Any, workers: Collection[str], scheduler: str | None) -> None:
    """Refuse workers that differ in more than the processor; one that does not answer is asked by its first task.

    Parameters
    ----------
    client : distributed.Client
    workers : collection of str
        Their addresses.
    scheduler : str or None
        Address of the scheduler that the caller named; None for workers that we started.

    Raises
    ------
    InputError, ForeignWorkerError
        Naming the first one, and what it has otherwise; the second for our own workers.
    """
    ask = {"workers": list(workers), "on_error": "return", "callback_timeout": _ANSWER_S}
    try:
        answers = client.sync(client._run, introduced, **ask)
    except TimeoutError:  # a busy machine; losses of the scheduler are other errors
        return
    for address, answer in sorted(answers.items()):
        if isinstance(answer, OSError):  # it has gone
            continue
        # Code without this module cannot answer.
        other = answer.differences() if isinstance(answer, Introduced) else [f"other code ({answer})".splitlines()[0]]
        if other and scheduler is not None:
            allowed = "a scheduler whose workers have this code and these libraries"
            raise InputError("--scheduler", scheduler, allowed=allowed, hint=_foreign(address, other))
        if other:
            raise ForeignWorkerError(f"{_foreign(address, other)}: were files changed while the run went on?")


def _foreign(address: str, other: list[str]) -> str:
    return f"worker {address} has {', '.join(other)}"
