"""Medial axes of many random regions: which are certified, how long they take, which fail and how.

    python benchmarks/regions.py --count 10000 --jobs 2 --seed 0
    python benchmarks/regions.py --kind spline --count 100
    python benchmarks/regions.py --one tangle 17

Each region goes to a worker process with a limit of seconds: a hang is a failure and the worker is
replaced. Region number i is `region(kinds[i % n], seed + i // n)`; `--one KIND SEED` repeats one.
The exit code is 1 if anything but a GeometryError stops a region, or if fewer than `--least` of
them are certified.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from statistics import median

from region_kinds import KINDS, region

CERTIFIED, REFUSED, BROKEN, HUNG = "certified", "GeometryError", "exception", "timeout"
OUTCOMES = (CERTIFIED, REFUSED, BROKEN, HUNG)
Task = tuple[str, int]


@dataclass(frozen=True)
class Record:
    """What became of one region."""

    kind: str
    seed: int
    outcome: str
    seconds: float
    message: str = ""


def attempt(task: Task, tol: float) -> Record:
    """Medial axis of one region; the time is that of the medial axis alone."""
    from grassfire.errors import GeometryError
    from grassfire.medial import medial_axis

    kind, seed = task
    given = region(kind, seed)
    begin = time.perf_counter()
    try:
        medial_axis(given, tol)
    except GeometryError as error:
        return Record(kind, seed, REFUSED, time.perf_counter() - begin, str(error))
    # Whatever else is raised is what this looks for.
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt | SystemExit):
            raise
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}:{last.lineno}"
        message = " ".join(f"{type(error).__name__} in {place}: {error}".split())
        return Record(kind, seed, BROKEN, time.perf_counter() - begin, message)
    return Record(kind, seed, CERTIFIED, time.perf_counter() - begin)


def serve(pipe: Connection, tol: float) -> None:
    """A worker: tasks in, "ready" and records out."""
    import grassfire.medial  # noqa: F401  (loading counts towards no region)

    pipe.send("ready")
    while True:
        task = pipe.recv()
        pipe.send(attempt(task, tol))


@dataclass
class Worker:
    """One process and what it is at."""

    tol: float
    limit: float
    process: SpawnProcess = field(init=False)
    pipe: Connection = field(init=False)
    task: Task | None = field(init=False, default=None)
    deadline: float = field(init=False)

    def __post_init__(self) -> None:
        self.start()

    def start(self) -> None:
        """A new process, waited for until it is ready."""
        context = multiprocessing.get_context("spawn")
        self.pipe, far = context.Pipe()
        self.process = context.Process(target=serve, args=(far, self.tol), daemon=True)
        self.process.start()
        far.close()
        self.pipe.recv()
        self.task, self.deadline = None, float("inf")

    def give(self, task: Task) -> None:
        """Let it work on a region."""
        self.task, self.deadline = task, time.monotonic() + self.limit
        self.pipe.send(task)

    def stop(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def result(self) -> Record:
        """What became of its region; a process that died is replaced."""
        assert self.task is not None
        try:
            record: Record = self.pipe.recv()
        except EOFError:
            self.process.join()
            reason = f"the process ended with exit code {self.process.exitcode}"
            record = Record(*self.task, BROKEN, 0.0, reason)
            self.stop()
            self.start()
        self.task, self.deadline = None, float("inf")
        return record

    def overdue(self) -> Record:
        """The record of a region that takes too long; the process is replaced."""
        assert self.task is not None
        record = Record(*self.task, HUNG, self.limit, f"more than {self.limit:g} s")
        self.stop()
        self.start()
        return record


def run(tasks: Sequence[Task], jobs: int, tol: float, limit: float) -> Iterator[Record]:
    """Records as they come."""
    waiting = deque(tasks)
    workers = [Worker(tol, limit) for _ in range(min(jobs, len(tasks)))]
    try:
        while True:
            for worker in workers:
                if worker.task is None and waiting:
                    worker.give(waiting.popleft())
            busy = [worker for worker in workers if worker.task is not None]
            if not busy:
                return
            pause = min(worker.deadline for worker in busy) - time.monotonic()
            ready = wait([worker.pipe for worker in busy], max(0.0, pause))
            for worker in busy:
                if worker.pipe in ready:
                    yield worker.result()
                elif time.monotonic() >= worker.deadline:
                    yield worker.overdue()
    finally:
        for worker in workers:
            worker.stop()


def table(records: Sequence[Record]) -> Iterator[str]:
    """One line per kind, and the total."""
    yield (
        f"| {'kind':16s} | regions | certified | GeometryError | exception | timeout "
        "| median ms | worst ms |"
    )
    yield "|---" + "|---:" * 7 + "|"
    kinds = sorted({record.kind for record in records})
    for kind in [*kinds, None]:
        rows = [record for record in records if kind is None or record.kind == kind]
        count = [sum(row.outcome == outcome for row in rows) for outcome in OUTCOMES]
        times = [1e3 * row.seconds for row in rows if row.outcome == CERTIFIED] or [float("nan")]
        yield (
            f"| {kind or 'all':16s} | {len(rows):7d} | {count[0]:9d} | {count[1]:13d} "
            f"| {count[2]:9d} | {count[3]:7d} | {median(times):9.1f} | {max(times):8.1f} |"
        )


def report(records: Sequence[Record], tol: float, least: float) -> tuple[str, bool]:
    """The table with the list of failures, and whether the bar is met."""
    failures = sorted(
        (record for record in records if record.outcome != CERTIFIED),
        key=lambda record: (record.kind, record.seed),
    )
    share = 1 - len(failures) / len(records)
    lines = [*table(records), "", f"tol {tol:g} mm: {100 * share:.3f} % certified", ""]
    lines += [f"- `{item.kind} {item.seed}` {item.outcome}: {item.message}" for item in failures]
    good = share >= least and all(item.outcome == REFUSED for item in failures)
    return "\n".join(lines).rstrip() + "\n", good


def show(kind: str, seed: int, tol: float) -> int:
    """One region with its certificate, or what it raises, in this process."""
    from grassfire.medial import medial_axis

    given = region(kind, seed)
    counts: dict[str, int] = {}
    for curve in given.curves:
        counts[type(curve).__name__] = counts.get(type(curve).__name__, 0) + 1
    pieces = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    bounds = ", ".join(f"{value:.6g}" for value in given.bounds())
    print(f"{kind} {seed}: {pieces}; {len(given.islands)} islands; bounds {bounds}", flush=True)
    begin = time.perf_counter()
    axis = medial_axis(given, tol)
    print(f"{1e3 * (time.perf_counter() - begin):.1f} ms; {len(axis.edges)} edges")
    print(axis.certificate)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="regions of all kinds together")
    parser.add_argument("--jobs", type=int, default=1, help="worker processes")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first region of each kind")
    parser.add_argument(
        "--kind", nargs="+", choices=sorted(KINDS), metavar="KIND", help="only these"
    )
    parser.add_argument("--tol", type=float, default=1e-6, help="mm")
    parser.add_argument("--limit-seconds", type=float, default=30.0, help="per region")
    parser.add_argument("--least", type=float, default=0.999, help="share to be certified")
    parser.add_argument("--one", nargs=2, metavar=("KIND", "SEED"), help="only this region")
    parser.add_argument("--out", type=Path, help="write the table and the failures here too")
    options = parser.parse_args(arguments)
    # Workers share the cores: one thread each.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if options.one:
        return show(options.one[0], int(options.one[1]), options.tol)
    kinds = options.kind or list(KINDS)
    tasks = [(kinds[i % len(kinds)], options.seed + i // len(kinds)) for i in range(options.count)]
    records = []
    for record in run(tasks, options.jobs, options.tol, options.limit_seconds):
        records.append(record)
        if record.outcome != CERTIFIED:
            text = f"{record.kind} {record.seed} {record.outcome}: {record.message}"
            print(f"{len(records)}/{len(tasks)} {text}", file=sys.stderr, flush=True)
    text, good = report(records, options.tol, options.least)
    print(text, end="")
    if options.out:
        options.out.write_text(text, encoding="utf-8")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
