"""The command line in this process."""

import pytest

from ibdata.cli import main


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """A function that runs `ibdata …` in an empty folder and returns exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ibdata.cli._end_at_signals", lambda: None)  # the tests have handlers of their own

    def run(*args):
        with pytest.raises(SystemExit) as end:
            main(args)
        return (end.value.code or 0, *capsys.readouterr())

    return run
