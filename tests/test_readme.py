"""Every command and every snippet of the README runs, in order, in one folder."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", TEXT, flags=re.MULTILINE | re.DOTALL)
VARIANTS = TEXT[TEXT.index("| variant | what it is |") : TEXT.index("All their differences")]
SHELL = [line for language, block in BLOCKS if language == "sh" for line in block.splitlines()]


def test_the_two_commands_come_first_and_are_what_ci_runs():
    assert SHELL[0].endswith("ibdata generate --config random.yaml")
    assert SHELL[1] == "scripts/test"
    assert "README.md" in (ROOT / ".ci/run").read_text()


TABLE = re.findall(r"^\| [^|]+ \| (?:`(ibdata [^`]+)`)? ?\| (?:`([^`]+)`)? ?\|$", TEXT, flags=re.MULTILINE)


def test_there_are_tasks_and_most_are_shown_twice():
    assert len(TABLE) >= 25
    assert sum(bool(line and code) for line, code in TABLE) >= 25


@pytest.mark.slow
def test_every_command_and_every_line_of_python_runs_in_order(command: str, tmp_path: Path):
    """As one script, each in its turn; --config random.yaml and the variants' table come first."""
    files = re.findall(r"^```\w+\n(# ([\w.]+)\n.*?)^```$", (ROOT / "docs/tasks.md").read_text(), re.M | re.S)
    for block, name in files:
        (tmp_path / name).write_text(block)
    assert {"cautious.yaml", "my_policy.py"} == {name for _, name in files}
    lines = [(line, "") for line in re.findall(r"\| `(ibdata generate [^`]+)` \| `", VARIANTS)]
    assert len(lines) == 2
    body = ["import subprocess", "import ibdata"]
    for line, code in (*lines, *TABLE):
        body += [f"subprocess.run({line!r}, shell=True, check=True)"] if line else []
        body += [code] if code else []
    script = tmp_path / "tasks.py"
    script.write_text("if __name__ == '__main__':\n" + "".join(f"    {line}\n" for line in body))
    env = {"PATH": f"{Path(command).parent}:/usr/bin:/bin", "HOME": str(Path.home())}
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_the_experiment_shown_is_valid(tmp_path: Path):
    from ibdata import load

    (shown,) = (block for language, block in BLOCKS if block.startswith("name: mine\n"))
    (tmp_path / "mine.yaml").write_text(shown)
    experiment = load(tmp_path / "mine.yaml")
    assert len(experiment.cells) == 12
    assert experiment.labels == ("random", "safe", "constant", "bad", "explored", "gaussian")


def test_the_table_of_variants_names_every_field_and_both_values():
    import dataclasses

    from ibdata.dynamics import PAPER, SIEMENS, Variant

    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", TEXT, flags=re.MULTILINE))
    for field in dataclasses.fields(Variant):
        _, paper, siemens = rows[field.name].split(" | ")
        for cell, value in ((paper, getattr(PAPER, field.name)), (siemens, getattr(SIEMENS, field.name))):
            if isinstance(value, int | float):
                assert f"{value:g}" in cell.split()[0]


def test_every_shipped_experiment_is_named():
    from ibdata.experiment import shipped, suites

    for name in (*shipped(), *suites()):
        assert f"`{name.split('/')[0]}`" in TEXT


def test_every_command_policy_and_format_that_is_named_exists():
    """Lists of all of them: `ibdata --help`, `ibdata policies`, `ibdata export --help`, docs/policies.md."""
    from ibdata.cli import cli
    from ibdata.exporters import FORMATS
    from ibdata.policies import POLICIES

    assert set(re.findall(r"`ibdata ([a-z]+)", TEXT)) <= set(cli.list_commands(None))
    assert set(re.findall(r"kind: (\w+)", TEXT)) <= set(POLICIES)
    (formats,) = re.findall(r"^\| Export to (.*?) \|", TEXT, flags=re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", formats)) <= set(FORMATS)
