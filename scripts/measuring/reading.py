"""Measure the time to read, validate and export a dataset."""

import pickle
from functools import partial

import pyarrow.parquet as pq

import ibdata
from ibdata.exporters import FORMATS
from measuring.timing import COMMAND, MILLION, Row, Scratch, described, paired, timed

# Peak memory in MB; not ru_maxrss, which a process inherits.
WINDOWS = """
import sys, ibdata
windows = ibdata.open(sys.argv[1]).windows(history=30)
print(int([line for line in open("/proc/self/status") if line.startswith("VmHWM")][0].split()[1]) / 1024)
"""


def reading(scratch: Scratch) -> list[Row]:
    """`validate`, `statistics` and `arrays` compared with reading the Parquet files with pyarrow."""
    dataset = scratch.generate(described(MILLION))
    opened = ibdata.open(dataset.path)
    read, validate, stats, command, one, thirty = paired(
        lambda: pq.read_table(dataset.path / "data"),
        lambda: ibdata.validate(dataset.path),
        lambda: ibdata.open(dataset.path).statistics(),
        lambda: scratch.run(COMMAND, "stats", dataset.path),
        lambda: opened.arrays(),
        lambda: opened.arrays(history=30),
    )
    speed = f"1.44 GB of arrays, written at {1.44 / thirty:.1f} GB/s"
    start = f"{command:.2f} s: Python's start"
    held = len(pickle.dumps(opened.windows(history=30))) / len(opened)
    peak = f"peak {scratch.script(WINDOWS, str(dataset.path)):.0f} MB, with Python and pyarrow"
    return [
        Row("reading, 1,000,000 rows", f"{read:.3f} s", "", "pyarrow, all columns, its own threads"),
        Row("validate, against reading", f"{validate / read:.1f} ×", "≤ 4 ×", f"{validate:.2f} s"),
        Row("statistics(), against reading", f"{stats / read:.2f} ×", "", "from meta/statistics.json"),
        Row("ibdata stats, against reading", f"{command / read:.1f} ×", "", start),
        Row("arrays(), against reading", f"{one / read:.1f} ×"),
        Row("arrays(history=30), against reading", f"{thirty / read:.1f} ×", "", speed),
        Row("windows(history=30), bytes a row", f"{held:.1f}", "≤ 26", peak),
    ]


def exports(scratch: Scratch) -> list[Row]:
    """The time of an export to each format whose library is installed."""
    dataset = scratch.generate(described(100_000, setpoints=70, episodes=100))
    out = scratch.folder / "exported"
    rows = []
    for name in FORMATS:
        try:
            seconds = timed(partial(ibdata.export, dataset, to=name, out=out / name, history=1))
        except ibdata.IbdataError as error:
            rows.append(Row(name, "–", "", str(error)))
            continue
        rows.append(Row(name, f"{seconds * 1e4:.0f} ns"))
    return rows
