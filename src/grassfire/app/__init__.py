"""The stages joined: from a job file to a verified program, its report and its picture.

This is the only package that knows all stages. Its functions take file names and return plain
results; nothing is printed here. What a function needs is imported when it runs.
"""

from grassfire.app.files import write_files
from grassfire.app.running import Judged, RunResult, preview, run, verify_file
from grassfire.app.stages import Emitted, Progress, Stopwatch, emit, judge
from grassfire.app.starter import starter_job
from grassfire.app.survey import STANDARD_DIAMETERS, AxisResult, inspect, mat

__all__ = [
    "STANDARD_DIAMETERS",
    "AxisResult",
    "Emitted",
    "Judged",
    "Progress",
    "RunResult",
    "Stopwatch",
    "emit",
    "inspect",
    "judge",
    "mat",
    "preview",
    "run",
    "starter_job",
    "verify_file",
    "write_files",
]
