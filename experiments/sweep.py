"""Many jobs at once, through Ray: on the processors of this machine, or on those of a cluster.

Every job is a Ray task that takes a fixed number of cores. Checkpoints, policies and results lie in the folders of the
study, which every machine of a cluster must see; so a task whose worker dies goes on, on whatever machine Ray tries it
again, from the last checkpoint.
"""

import dataclasses
import importlib
import logging
import socket
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from cruise.cli.experiments import call
from cruise.errors import CruiseError, one_line
from experiments.own_cores import own_cores
from experiments.plan import Job
from experiments.results import ResultFolder
from experiments.study import Event, run_jobs
from experiments.work import Work

RETRIES = 5  # of a task whose worker died
TOLD = 1000  # characters of what went wrong


@dataclasses.dataclass(frozen=True)
class Cluster:
    """Where tasks run."""

    address: str | None = None  # of a cluster's head; None: this machine alone
    cores: int | None = None  # for each job; None: what its share is of all


def run_job(work: Work, job: Job) -> Event:
    """Run one job in this process and tell how it ended, also where another process has done it already."""
    events = list(run_jobs(work, (job,)))
    return events[-1] if events else Event(job, "done")


def sweep(
    work: Work,
    jobs: Sequence[Job],
    cluster: Cluster,
    prepare: Callable[[int], None],
    run: Callable[[Work, Job], Event] = run_job,
) -> Iterator[Event]:
    """Run jobs as Ray lets them; races between policies once all else has ended. Yields how each ended.

    Args:
        work: the study; the same folders on every machine.
        jobs: of the study.
        cluster: where.
        prepare: called in a worker before anything else, with the cores it may use.
        run: what a worker does with the study and a job.

    Raises:
        CruiseError: Ray is not installed, does not start, or has no machine with so many cores.
    """
    try:
        ray = importlib.import_module("ray")
    except ImportError:
        raise CruiseError("a sweep needs Ray: pip install -c constraints.txt ray") from None
    cores = _start(ray, cluster, len(jobs))
    work = dataclasses.replace(work, folder=work.folder.absolute(), results=ResultFolder(work.results.path.absolute()))

    # One job per worker process: JAX counts its devices once, and a process that trained keeps what it compiled.
    remote = ray.remote(num_cpus=cores, max_retries=RETRIES, max_calls=1)(call)
    try:
        for last in (False, True):
            wave = [job for job in jobs if (job.family == "head-to-head") is last]
            tasks = {job: ray.cloudpickle.dumps((_task, (work, job, cores, prepare, run))) for job in wave}
            yield from _as_they_end(ray, {remote.remote(task): job for job, task in tasks.items()})
    finally:
        ray.shutdown()


def _task(work: Work, job: Job, cores: int, prepare: Callable[[int], None], run: Callable[[Work, Job], Event]) -> Event:
    with own_cores(cores):
        prepare(cores)
        return run(work, job)


def _as_they_end(ray: Any, running: dict[Any, Job]) -> Iterator[Event]:
    while running:
        (ended, *_), _ = ray.wait(list(running), num_returns=1)
        job = running.pop(ended)
        try:
            yield ray.get(ended)
        except ray.exceptions.RayError as error:
            yield Event(job, "failed", message=one_line(error, TOLD))


def _find(address: str) -> None:
    """Knock at a cluster's head: Ray itself would wait a minute, then fill the screen."""
    host, _, port = address.rpartition(":")
    if not (host and port.isdecimal() and int(port) < 2**16):
        raise CruiseError(f"--address must be HOST:PORT or auto, not {address!r}")
    try:
        socket.create_connection((host, int(port)), timeout=10).close()
    except OSError as error:
        raise CruiseError(f"no Ray cluster answers at {address}: {error}") from None


def _start(ray: Any, cluster: Cluster, jobs: int) -> int:
    """Start Ray, or join the cluster; gives the cores for each of so many jobs."""
    if cluster.address not in (None, "auto"):
        _find(cluster.address)
    logging.getLogger("ray").setLevel(logging.ERROR)  # `logging_level` leaves out what Ray says before it starts
    local = {"include_dashboard": False} if cluster.address is None else {"address": cluster.address}
    try:
        ray.init(log_to_driver=False, logging_level="ERROR", configure_logging=False, **local)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise CruiseError(f"Ray does not start: {one_line(error, TOLD)}") from None
    machines = [int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]]
    most = max(machines, default=0)
    cores = min(most, max(1, sum(machines) // max(1, jobs))) if cluster.cores is None else cluster.cores
    if not 1 <= cores <= most:
        ray.shutdown()
        raise CruiseError(f"--cores must be between 1 and {most}, as many as the largest machine has, not {cores}")
    return cores
