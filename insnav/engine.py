"""Parallel execution of jobs in processes or on a Dask cluster, with results in order and identical to serial ones.

joblib distributes the jobs. This module selects the workers, and handles failing jobs and dying processes. Workers are
processes, not threads: much of a run is Python, and the compiled kernels hold the interpreter's lock.
"""

from __future__ import annotations

import logging
import os
import pickle
import re
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

from insnav.exceptions import ConfigError, InsnavError, reason_of

J = TypeVar("J")
T = TypeVar("T")
Workers = int | str  # number of processes, or an engine: ``processes:4``, ``dask:tcp://10.0.0.1:8786``

IDLE = 10.0  # workers without a job end after this time [s]
_LOOPBACK = "127.0.0.1"
CONNECT = 10.0  # longest response time of a scheduler and its workers [s]
_FORM = re.compile(r"processes(?::(?P<count>\d+))?|dask(?::(?P<address>.+))?|(?P<number>\d+)")
_LEFT_BEHIND = "ignore:resource_tracker:UserWarning"
_log = logging.getLogger(__name__)
_STOPS = (signal.SIGINT, signal.SIGTERM)
_one_at_a_time = threading.RLock()  # threads of a Dask worker share data, so only one job runs at a time


@dataclass(frozen=True, slots=True)
class Engine:
    """Workers that execute the jobs."""

    processes: int = 1  # number of processes on this machine; 1: jobs run in the calling process
    dask: str | None = None  # address of a Dask scheduler; empty: a cluster of local workers; None: no Dask


def engine_of(workers: Workers) -> Engine:
    """Parse an engine from a number of processes or a text: ``processes[:N]``, ``dask[:ADDRESS]``.

    Raises: ConfigError: another text, a number of processes below 1, or Dask is not installed.
    """
    form = _FORM.fullmatch(str(workers).strip())
    if form is None:
        raise ConfigError("engine.unknown", where="--engine", engine=str(workers))
    if "dask" in form[0]:
        _need_dask()
        return Engine(_processors(), form["address"] or "")
    count = form["count"] or form["number"]
    if count is not None and int(count) < 1:
        raise ConfigError("engine.no_process", where="--engine", count=int(count))
    return Engine(_processors() if count is None else int(count))


def each(
    function: Callable[..., T], jobs: Sequence[J], workers: Workers = 1, shared: tuple[Any, ...] = ()
) -> Generator[T | InsnavError]:
    """Run ``function(*shared, job)`` for every job on the workers, and yield the outcomes in the order of the jobs.

    `function`: of a module that the workers can import. `shared`: arguments that each worker receives once.
    Yields: results; an `InsnavError` if the function raised, or its process died twice. If a process dies, for example
    for lack of memory, the unfinished jobs of all workers are repeated. They run one at a time, to find the cause.
    """
    engine = engine_of(workers)
    if engine.dask is None and (engine.processes == 1 or len(jobs) < 2):
        for job in jobs:
            yield attempt(function, *shared, job)
        return
    from concurrent.futures.process import BrokenProcessPool

    died: tuple[type[BaseException], ...] = (BrokenProcessPool,)
    if engine.dask is not None:
        from distributed.scheduler import KilledWorker

        died = (*died, KilledWorker)
    with _pool(engine, len(jobs), shared) as pool:
        following = alone_until = last = 0  # next job to yield, end of jobs to run alone, last job handed out

        def handed(stop: int) -> Iterator[J]:
            nonlocal last
            for last in range(following, stop):
                yield jobs[last]

        while following < len(jobs):
            alone, last = following < alone_until, following
            numbers = handed(following + 1 if alone else len(jobs))
            try:
                with closing(pool(attempt, function, *shared, jobs=numbers)) as outcomes:
                    for outcome in outcomes:
                        following += 1
                        yield outcome
            except died as error:
                if alone:  # this job ended its process twice
                    following += 1
                    yield InsnavError("engine.process_died", reason=str(error).split(". ")[0])
                else:
                    alone_until = last + 1
                    _log.warning("insnav: a process died; jobs %d to %d are repeated", following + 1, alone_until)


def every(
    function: Callable[..., T],
    jobs: Sequence[J],
    workers: Workers = 1,
    shared: tuple[Any, ...] = (),
    progress: Callable[[float], None] | None = None,
) -> Generator[T]:
    """Yield the result of every job in order; raise the first error. `progress`: called with the completed fraction."""
    with closing(each(function, jobs, workers, shared)) as outcomes:
        for number, outcome in enumerate(outcomes, start=1):
            if isinstance(outcome, InsnavError):
                raise outcome
            yield outcome
            if progress is not None:
                progress(number / len(jobs))


def share_of(progress: Callable[[float], None] | None, begin: float, part: float) -> Callable[[float], None] | None:
    """Convert the progress of one part, which begins at fraction `begin` of the work, to the overall progress."""
    return None if progress is None else lambda done: progress(begin + part * done)


def attempt(function: Callable[..., T], *arguments: Any) -> T | InsnavError:
    """Return the result of a function, or the error that it raises, as an `InsnavError` without traceback."""
    try:
        with _one_at_a_time:
            return function(*arguments)
    except InsnavError as error:
        error.__cause__ = error.__context__ = None
        return error.with_traceback(None)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}:{last.lineno}"
        return InsnavError("engine.job_defect", kind=type(error).__name__, reason=str(error), place=place)


Pool = Callable[..., Generator[Any]]


@contextmanager
def _pool(engine: Engine, jobs: int, shared: tuple[Any, ...]) -> Iterator[Pool]:
    """Provide a function that runs jobs on workers: it takes a function, its first arguments and jobs."""
    from joblib import Parallel, delayed, parallel_config

    def work(config: dict[str, Any], how: dict[str, Any], *call: Any, jobs: Iterator[Any]) -> Generator[Any]:
        function, *first = call
        with parallel_config(**config):
            results = Parallel(return_as="generator", **how)(delayed(function)(*first, job) for job in jobs)
            try:
                for result in results:  # noqa: UP028 - `yield from` would close `results`, which warns
                    yield result
            finally:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # joblib warns about unused results, which are intended here
                    results.close()

    if engine.dask is None:
        # loky's cleanup process warns when it removes files of stopped processes: this option silences the warning
        sys.warnoptions += {_LEFT_BEHIND} - {*sys.warnoptions}
        config = {"backend": "loky", "inner_max_num_threads": 1, "n_jobs": min(engine.processes, jobs)}
        how = {"idle_worker_timeout": IDLE, "initializer": _serve, "initargs": (os.getpid(),)}
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="A worker stopped")  # another worker receives its jobs
            yield partial(work, config, how)
        return
    with _client(engine, jobs) as client:
        yield partial(work, {"backend": _dask_backend(client, shared)}, {})


def _serve(parent: int) -> None:
    """Set up a worker process: it ignores Ctrl-C, which its parent process handles, and ends with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def dask_setup(worker: object) -> None:
    """Set up a local Dask worker; Dask prescribes the name of this function."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)  # the parent process has ended


def _processors() -> int:
    import joblib

    return int(joblib.cpu_count())


def _need_dask() -> None:
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise ConfigError("engine.no_dask", where="--engine", reason=reason_of(error)) from error


@contextmanager
def _client(engine: Engine, jobs: int) -> Iterator[Any]:
    """Connect to the Dask scheduler at the address of the engine, or start a local Dask cluster; yield the client."""
    dask: Any = import_module("dask")
    distributed: Any = import_module("distributed")
    with ExitStack() as stack:
        if threading.current_thread() is threading.main_thread():
            stack.callback(_handle, {number: signal.getsignal(number) for number in _STOPS})
        if engine.dask:
            client = stack.enter_context(_connected(distributed, engine.dask))
        else:
            settings: dict[str, Any] = {"threads_per_worker": 1, "silence_logs": logging.CRITICAL}
            settings |= {"n_workers": min(engine.processes, jobs), "preload": __name__}  # Dask calls `dask_setup`
            settings |= {"host": _LOOPBACK, "dashboard_address": f"{_LOOPBACK}:0"}  # not visible to other machines
            settings |= {"worker_dashboard_address": f"{_LOOPBACK}:0"}
            # Dask stops at the first dead worker and repeats nothing, since `each` repeats the jobs
            stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": 0}))
            client = stack.enter_context(distributed.Client(stack.enter_context(distributed.LocalCluster(**settings))))
        try:
            yield client
        except (Exception, GeneratorExit):
            raise
        except BaseException:  # a stop request: ignore further requests while closing
            if threading.current_thread() is threading.main_thread():
                _handle(dict.fromkeys(_STOPS, signal.SIG_IGN))
            raise


def _handle(handlers: dict[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


def _connected(distributed: Any, address: str) -> Any:
    """Connect to a scheduler; it must have workers, all with this version of insnav."""
    where = f"--engine dask:{address}"
    try:
        client = distributed.Client(address, timeout=CONNECT)
        client.wait_for_workers(1, timeout=CONNECT)
        versions: dict[str, str] = client.run(_version)
    except (OSError, TimeoutError, ValueError, ImportError) as error:
        raise ConfigError("engine.no_cluster", where=where, reason=reason_of(error)) from error
    for worker, version in versions.items():
        if version != _version():
            client.close()
            raise ConfigError("engine.other_version", where=where, worker=worker, other=version, own=_version())
    return client


def _version() -> str:
    return str(sys.modules["insnav"].__version__)


def _dask_backend(client: Any, shared: tuple[Any, ...]) -> Any:
    """Build joblib's Dask backend for a client; shared data are Dask results, which the cluster recomputes if lost."""
    from joblib import parallel_config
    from joblib.parallel import get_active_backend

    with parallel_config(backend="dask", client=client):
        base: Any = type(get_active_backend()[0])

    class Backend(base):  # type: ignore[misc]
        """Backend that reports dead workers, for which joblib would wait forever, and never works in this process."""

        def effective_n_jobs(self, n_jobs: int) -> int:
            return max(2, int(super().effective_n_jobs(n_jobs)))  # with one worker, joblib would use this process

        def submit(self, func: Any, callback: Any = None) -> Any:
            future = super().submit(func, callback)
            future.add_done_callback(lambda done: done.exception() is None or callback(done.exception()))
            return future

        def retrieve_result_callback(self, out: Any) -> Any:
            if isinstance(out, BaseException):
                raise out
            return super().retrieve_result_callback(out)

    backend = Backend(client=client)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask warns about large data, which are sent only once here
        futures = [client.submit(pickle.loads, pickle.dumps(data), pure=False) for data in shared]
    backend.data_futures = {id(data): future for data, future in zip(shared, futures, strict=True)}
    return backend
