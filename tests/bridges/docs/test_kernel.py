"""Interrupting a notebook: the cell ends with KeyboardInterrupt, and is right when it is run again."""

import time

import pytest
from jupyter_client.manager import KernelManager

GENERATE = """
import ibdata
plain = {"name": "x", "setpoints": [20, 70], "episodes": 4, "steps": 50, "policies": ["random"]}
print(len(ibdata.generate(plain, "x", workers=1).stored.episodes))
"""
VALIDATE = "print(ibdata.validate('x'), len(ibdata.open('x').episodes))"


def run(client, code, seconds=60, interrupt=None):
    """The name of a cell's error, or what it prints; `interrupt` is called once, some time after it began."""
    sent, printed, error = client.execute(code), "", None
    while True:
        message = client.get_iopub_msg(timeout=seconds)
        if message["parent_header"].get("msg_id") != sent:
            continue
        content = message["content"]
        printed += content.get("text", "") if content.get("name") == "stdout" else ""
        error = content.get("ename", error)
        if content.get("execution_state") == "busy" and interrupt is not None:
            interrupt()
        if content.get("execution_state") == "idle":
            return error or printed


@pytest.mark.parametrize("delay", [0.02, 0.1, 0.2, 0.3, 0.45])
def test_an_interrupted_cell_ends_and_can_be_run_again(tmp_path, delay):
    """The first `validate` of a kernel imports pandas, beside threads that read."""
    manager = KernelManager()
    manager.start_kernel(cwd=str(tmp_path))
    client = manager.client()
    try:
        client.start_channels()
        client.wait_for_ready(timeout=60)
        assert run(client, GENERATE) == "8\n"
        ended = run(client, VALIDATE, interrupt=lambda: (time.sleep(delay), manager.interrupt_kernel()))
        assert ended == "KeyboardInterrupt" or (ended == "no problems 8\n" and delay > 0.1), (
            ended
        )  # it was too late
        assert run(client, VALIDATE) == "no problems 8\n"
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
