"""A table of the largest differences, printed after the run."""

from __future__ import annotations

from collections import defaultdict

import pytest

LABEL = "largest difference"


@pytest.fixture
def report(record_property):
    """Put a table of differences under a heading into the summary, and the JUnit file, of the run."""

    def put(heading, transitions, table):
        record_property(f"{LABEL}|{heading}|transitions", transitions)
        for field, value in table.items():
            record_property(f"{LABEL}|{heading}|{field}", value)

    return put


def pytest_terminal_summary(terminalreporter):
    columns, order = defaultdict(dict), []
    for outcome in ("passed", "failed"):
        for result in terminalreporter.stats.get(outcome, []):
            for name, value in getattr(result, "user_properties", ()):
                if name.startswith(f"{LABEL}|"):
                    _, heading, field = name.split("|")
                    columns[heading][field] = value
                    if field not in order:
                        order.append(field)
    if not columns:
        return
    terminalreporter.section(f"{LABEL} / max(1, |value|)")
    terminalreporter.write_line("  ".join([" " * 20, *columns]))
    for field in order:
        cells = [f"{field:20}"]
        for heading, table in columns.items():
            x = table.get(field, "")
            cells.append((f"{x:.1e}" if isinstance(x, float) else str(x)).rjust(len(heading)))
        terminalreporter.write_line("  ".join(cells))
