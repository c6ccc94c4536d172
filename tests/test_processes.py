"""Children end with their parent, whether it ends by SIGTERM, SIGKILL or a closed terminal."""

import contextlib
import os
import pty
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from meal_bayes import processes

ROOT = Path(processes.__file__).resolve().parents[1]

FOREIGN = """
import time
from meal_bayes.processes import start
start(["/bin/sh", "-c", "echo $$; exec sleep 1000"])
time.sleep(1000)
"""
PYTHON = """
import os, time
from meal_bayes.experiments.parallel import in_parallel
def work(piece):
    os.write(1, b"%d\\n" % os.getpid())  # at once, whoever else writes
    time.sleep(1000)
list(in_parallel(work, range(2), jobs=2))
"""
CONTEXT = """
import os, time
from meal_bayes.processes import ending_context
def work(*piece):
    os.write(1, b"%d\\n" % os.getpid())  # at once, whoever else writes
    time.sleep(1000)
context = ending_context()
for k in range(2):
    context.Process(target=work, args=(k,), daemon=True).start()
time.sleep(1000)
"""


@contextlib.contextmanager
def run(code, **options):
    """Run a program, and let a failure in the block not wait for its end."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, env=environment, text=True, **options) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.long
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize(("code", "count"), [(FOREIGN, 1), (PYTHON, 2), (CONTEXT, 2)])
def test_children_end_with_a_killed_parent(code, count, kind, running, eventually):
    with run(code, stdout=subprocess.PIPE) as parent:
        children = [int(parent.stdout.readline()) for _ in range(count)]
        assert all(map(running, children))
        parent.send_signal(kind)
        parent.wait()
        eventually(lambda: not any(map(running, children)))


def _adopt(terminal):
    os.close(os.open(os.ttyname(terminal), os.O_RDWR))  # which makes it ours
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it would be ignored


@pytest.mark.long
@pytest.mark.parametrize(("code", "count"), [(FOREIGN, 1), (PYTHON, 2)])
def test_children_end_with_the_terminal(code, count, running, eventually):
    inside, outside = pty.openpty()[::-1]
    with run(
        code, stdout=subprocess.PIPE, stdin=inside, stderr=inside, start_new_session=True,
        preexec_fn=partial(_adopt, inside),
    ) as parent:  # fmt: skip
        os.close(inside)
        children = [int(parent.stdout.readline()) for _ in range(count)]
        os.close(outside)
        parent.wait()
        assert parent.returncode == -signal.SIGHUP
        eventually(lambda: not any(map(running, children)))


def test_a_foreign_program_keeps_its_number_and_its_exit_code():
    child = processes.start(["/bin/sh", "-c", "echo $$; exit 7"], output=subprocess.PIPE)
    said, _ = child.communicate()
    assert int(said) == child.pid
    assert child.returncode == 7


def test_a_child_whose_parent_is_gone_already_does_not_begin():
    code = "from meal_bayes.processes import end_with_parent\nend_with_parent(1)\nprint('here')"
    with run(code, stdout=subprocess.PIPE) as child:
        assert child.communicate()[0] == ""
        assert child.returncode == 1


def test_elsewhere_a_guard_ends_the_program(running, eventually):
    """As on systems whose kernel cannot be asked."""
    code = (
        "import os, subprocess, sys, time\n"
        "guard = 'import sys; from meal_bayes import processes as p; "
        "sys.exit(p._guard(int(sys.argv[1]), sys.argv[2:]))'\n"
        "subprocess.Popen([sys.executable, '-c', guard, str(os.getpid()), '/bin/sh', '-c', "
        "'echo $$; exec sleep 1000'])\ntime.sleep(1000)\n"
    )
    with run(code, stdout=subprocess.PIPE) as parent:
        child = int(parent.stdout.readline())
        parent.kill()
        parent.wait()
        eventually(lambda: not running(child))
